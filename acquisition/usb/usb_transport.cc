#include "acquisition/usb/usb_transport.h"

#include <fmt/format.h>
#include <libusb.h>

#include <algorithm>
#include <array>
#include <deque>

namespace gnathion {
namespace {

using std::chrono::milliseconds;

/// Reads kept in flight, so that the tracker finds a buffer whenever it has a frame, and their size: a tenth
/// of a second of the fastest tracker (16 sensors at 240 Hz).
constexpr std::size_t kReads = 4, kReadBytes = 4096;
constexpr unsigned kWriteTimeoutMs = 150, kControlTimeoutMs = 500;
constexpr milliseconds kCancelPatience{1000};

TransferStatus status_of_error(int error) {
  switch (error) {
    case LIBUSB_SUCCESS:
    case LIBUSB_ERROR_IO:
    case LIBUSB_ERROR_ACCESS:
    case LIBUSB_ERROR_NO_DEVICE:
    case LIBUSB_ERROR_BUSY:
    case LIBUSB_ERROR_TIMEOUT:
    case LIBUSB_ERROR_OVERFLOW:
    case LIBUSB_ERROR_PIPE:
      return static_cast<TransferStatus>(error);
    default:
      return kTransferOther;
  }
}
TransferStatus status_of_transfer(libusb_transfer_status status) {
  switch (status) {
    case LIBUSB_TRANSFER_COMPLETED:
    case LIBUSB_TRANSFER_CANCELLED:  // our own doing, when reads start anew: what had arrived is good
      return kTransferOk;
    case LIBUSB_TRANSFER_TIMED_OUT:
      return kTransferTimeout;
    case LIBUSB_TRANSFER_STALL:
      return kTransferStall;
    case LIBUSB_TRANSFER_NO_DEVICE:
      return kTransferGone;
    case LIBUSB_TRANSFER_OVERFLOW:
      return kTransferOverflow;
    default:
      return kTransferIo;
  }
}

struct Endpoints {
  std::uint8_t in = 0, out = 0;
  std::size_t in_packet = 0;
};

const char* type_name(std::uint8_t attributes) {
  static constexpr const char* names[] = {"control", "isochronous", "bulk", "interrupt"};
  return names[attributes & 3];
}

/// The bulk endpoints of the first interface, or what is wrong with its descriptor.
tl::expected<Endpoints, std::string> endpoints_of(const libusb_config_descriptor& config) {
  if (config.bNumInterfaces == 0 || config.interface[0].num_altsetting == 0)
    return tl::unexpected(std::string("its descriptor names no interface"));
  const libusb_interface_descriptor& face = config.interface[0].altsetting[0];
  Endpoints found;
  std::vector<std::string> others;
  for (int i = 0; i < face.bNumEndpoints; ++i) {
    const libusb_endpoint_descriptor& e = face.endpoint[i];
    if ((e.bmAttributes & 3) != LIBUSB_TRANSFER_TYPE_BULK) {
      others.push_back(fmt::format("0x{:02x} is {}", e.bEndpointAddress, type_name(e.bmAttributes)));
      continue;
    }
    const std::size_t packet = e.wMaxPacketSize & 0x7ff;
    if (packet == 0)
      return tl::unexpected(
          fmt::format("its endpoint 0x{:02x} claims packets of 0 bytes", e.bEndpointAddress));
    if (e.bEndpointAddress & LIBUSB_ENDPOINT_IN) {
      if (found.in == 0) found.in = e.bEndpointAddress, found.in_packet = packet;
    } else if (found.out == 0) {
      found.out = e.bEndpointAddress;
    }
  }
  const std::string rest = others.empty() ? "" : fmt::format(" ({})", fmt::join(others, ", "));
  if (found.in == 0) return tl::unexpected("its interface has no bulk endpoint to read from" + rest);
  if (found.out == 0) return tl::unexpected("its interface has no bulk endpoint to write to" + rest);
  return found;
}

std::string port_of(libusb_device* device) {
  std::array<std::uint8_t, 8> ports{};
  const int n = libusb_get_port_numbers(device, ports.data(), static_cast<int>(ports.size()));
  std::string text = std::to_string(libusb_get_bus_number(device));
  for (int i = 0; i < n; ++i) text += (i == 0 ? "-" : ".") + std::to_string(ports[i]);
  return text;
}

class UsbTransport : public Transport {
 public:
  UsbTransport(libusb_context* context, libusb_device_handle* handle, Endpoints endpoints,
               InstrumentIdentity identity, std::string descriptors, Clock& clock)
      : context_(context),
        handle_(handle),
        endpoints_(endpoints),
        identity_(std::move(identity)),
        descriptors_{kDescriptorEndpoint, kTransferOk, std::move(descriptors), clock.now()},
        clock_(clock) {
    const std::size_t size =
        (kReadBytes + endpoints_.in_packet - 1) / endpoints_.in_packet * endpoints_.in_packet;
    for (Slot& slot : *slots_) {
      slot.owner = this;
      slot.buffer.resize(size);
      slot.transfer = libusb_alloc_transfer(0);
      libusb_fill_bulk_transfer(slot.transfer, handle_, endpoints_.in, slot.buffer.data(),
                                static_cast<int>(size), &UsbTransport::ended, &slot, 0);
    }
    for (Slot& slot : *slots_) submit(slot);
  }

  ~UsbTransport() override {
    if (!land()) {  // the kernel still owns the buffers: better lost than written to when freed
      for (Slot& slot : *slots_) slot.owner = nullptr;
      static_cast<void>(slots_.release());
      return;
    }
    for (Slot& slot : *slots_) libusb_free_transfer(slot.transfer);
    libusb_release_interface(handle_, 0);
    libusb_close(handle_);
  }

  std::optional<Transfer> read(milliseconds timeout) override {
    if (done_.empty() && failed_) revive();
    if (done_.empty()) handle_events(timeout);
    if (done_.empty()) return std::nullopt;
    Transfer first = std::move(done_.front());
    done_.pop_front();
    return first;
  }

  Transfer write(std::string_view bytes) override {
    std::string copy(bytes);
    int sent = 0;
    const int error =
        libusb_bulk_transfer(handle_, endpoints_.out, reinterpret_cast<unsigned char*>(copy.data()),
                             static_cast<int>(copy.size()), &sent, kWriteTimeoutMs);
    TransferStatus status = status_of_error(error);
    if (error == 0 && sent != static_cast<int>(copy.size())) status = kTransferIo;
    if (status == kTransferStall) libusb_clear_halt(handle_, endpoints_.out);
    return {endpoints_.out, status, std::move(copy), clock_.now()};
  }

  Transfer descriptors() const override { return descriptors_; }
  const InstrumentIdentity& identity() const override { return identity_; }

 private:
  struct Slot {
    UsbTransport* owner = nullptr;
    libusb_transfer* transfer = nullptr;
    std::vector<std::uint8_t> buffer;
    bool flying = false;
  };

  /// libusb calls this inside handle_events(), reads in the order in which they were submitted.
  static void LIBUSB_CALL ended(libusb_transfer* transfer) {
    auto* slot = static_cast<Slot*>(transfer->user_data);
    slot->flying = false;
    if (slot->owner) slot->owner->take(*slot);
  }

  void take(Slot& slot) {
    const libusb_transfer& t = *slot.transfer;
    const TransferStatus status = status_of_transfer(t.status);
    const bool cancelled = t.status == LIBUSB_TRANSFER_CANCELLED;
    if (!cancelled || t.actual_length > 0)
      done_.push_back({endpoints_.in, status,
                       std::string(reinterpret_cast<const char*>(slot.buffer.data()),
                                   static_cast<std::size_t>(t.actual_length)),
                       clock_.now()});
    if (status != kTransferOk) failed_ = true;
    if (!cancelled && !failed_) submit(slot);
  }

  void submit(Slot& slot) {
    const int error = libusb_submit_transfer(slot.transfer);
    slot.flying = error == 0;
    if (error == 0) return;
    if (!failed_) done_.push_back({endpoints_.in, status_of_error(error), {}, clock_.now()});
    failed_ = true;
  }

  /// After an error: all reads down, the halt cleared, all reads up again.
  void revive() {
    land();
    if (!done_.empty()) return;  // hand out first what came down
    if (any_flying()) return;
    libusb_clear_halt(handle_, endpoints_.in);
    failed_ = false;
    for (Slot& slot : *slots_)
      if (!failed_) submit(slot);
  }

  /// Cancels what flies and waits until it is down; false if the kernel keeps it.
  bool land() {
    failed_ = true;
    for (Slot& slot : *slots_)
      if (slot.flying) libusb_cancel_transfer(slot.transfer);
    for (milliseconds waited{0}; any_flying() && waited < kCancelPatience; waited += milliseconds(10))
      handle_events(milliseconds(10));
    return !any_flying();
  }

  bool any_flying() const {
    return std::any_of(slots_->begin(), slots_->end(), [](const Slot& s) { return s.flying; });
  }

  void handle_events(milliseconds timeout) {
    timeval tv{timeout.count() / 1000, (timeout.count() % 1000) * 1000};
    libusb_handle_events_timeout_completed(context_, &tv, nullptr);
  }

  libusb_context* context_;
  libusb_device_handle* handle_;
  Endpoints endpoints_;
  InstrumentIdentity identity_;
  Transfer descriptors_;
  Clock& clock_;
  std::unique_ptr<std::array<Slot, kReads>> slots_ = std::make_unique<std::array<Slot, kReads>>();
  std::deque<Transfer> done_;
  bool failed_ = false;  ///< reads are down until revive()
};

/// A device that fits, referenced; opened when it could be.
struct Candidate {
  libusb_device* device = nullptr;
  libusb_device_handle* handle = nullptr;
  int open_error = 0;
  libusb_device_descriptor descriptor{};
  InstrumentIdentity identity;
};

class UsbFinder : public TransportFinder {
 public:
  UsbFinder(libusb_context* context, std::vector<UsbProduct> products, InstrumentChoice choice,
            std::string what, std::string where, Clock& clock)
      : context_(context),
        products_(std::move(products)),
        choice_(std::move(choice)),
        what_(std::move(what)),
        where_(std::move(where)),
        clock_(clock) {
    hotplug_ = libusb_hotplug_register_callback(
                   context_, LIBUSB_HOTPLUG_EVENT_DEVICE_ARRIVED | LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT, 0,
                   LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY,
                   [](libusb_context*, libusb_device*, libusb_hotplug_event, void*) { return 0; }, nullptr,
                   &callback_) == LIBUSB_SUCCESS;
  }
  ~UsbFinder() override {
    if (hotplug_) libusb_hotplug_deregister_callback(context_, callback_);
    libusb_exit(context_);
  }

  Result<std::unique_ptr<Transport>> open() override;
  void wait_for_change(milliseconds timeout) override {
    timeval tv{timeout.count() / 1000, (timeout.count() % 1000) * 1000};
    libusb_handle_events_timeout_completed(context_, &tv, nullptr);  // returns early when devices come or go
  }

 private:
  const UsbProduct* product_of(const libusb_device_descriptor& d) const {
    for (const UsbProduct& p : products_)
      if (p.vendor == d.idVendor && p.product == d.idProduct) return &p;
    return nullptr;
  }
  std::string failed() const { return "cannot open " + what_; }
  std::string string_of(const Candidate& c, std::uint8_t index) const;
  Candidate candidate(libusb_device* device, const libusb_device_descriptor& descriptor,
                      const UsbProduct& product) const;
  Result<std::unique_ptr<Transport>> open(Candidate& chosen);

  libusb_context* context_;
  libusb_hotplug_callback_handle callback_{};
  bool hotplug_ = false;
  std::vector<UsbProduct> products_;
  InstrumentChoice choice_;
  std::string what_, where_;
  Clock& clock_;
  std::optional<InstrumentIdentity> last_;
};

std::string UsbFinder::string_of(const Candidate& c, std::uint8_t index) const {
  std::array<unsigned char, 256> text{};
  if (!c.handle || index == 0) return {};
  const int n =
      libusb_get_string_descriptor_ascii(c.handle, index, text.data(), static_cast<int>(text.size()));
  return n > 0 ? std::string(reinterpret_cast<char*>(text.data()), static_cast<std::size_t>(n))
               : std::string();
}

Candidate UsbFinder::candidate(libusb_device* device, const libusb_device_descriptor& descriptor,
                               const UsbProduct& product) const {
  Candidate c;
  c.device = device;
  c.descriptor = descriptor;
  c.open_error = libusb_open(device, &c.handle);
  c.identity = {descriptor.idVendor,
                descriptor.idProduct,
                string_of(c, descriptor.iManufacturer),
                product.model,
                string_of(c, descriptor.iSerialNumber),
                port_of(device)};
  return c;
}

Result<std::unique_ptr<Transport>> UsbFinder::open() {
  libusb_device** list = nullptr;
  const ssize_t count = libusb_get_device_list(context_, &list);
  if (count < 0)
    return fail(ErrorCode::kInternal, failed(), where_, libusb_strerror(static_cast<libusb_error>(count)));
  std::vector<Candidate> candidates;
  std::string raw;  // one that waits for its firmware
  for (ssize_t i = 0; i < count; ++i) {
    libusb_device_descriptor descriptor{};
    if (libusb_get_device_descriptor(list[i], &descriptor) != 0) continue;
    const UsbProduct* product = product_of(descriptor);
    if (!product) continue;
    if (product->needs_firmware)
      raw = fmt::format("{} at port {}", usb_id(descriptor.idVendor, descriptor.idProduct), port_of(list[i]));
    else
      candidates.push_back(candidate(list[i], descriptor, *product));
  }
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.identity.port < b.identity.port; });
  auto result = [&]() -> Result<std::unique_ptr<Transport>> {
    if (candidates.empty() && !raw.empty())
      return bad_input(failed(), where_,
                       fmt::format("{} has no firmware yet; its loader must run first "
                                   "(docs/devices/polhemus.md)",
                                   raw));
    std::vector<InstrumentIdentity> found;
    for (const Candidate& c : candidates) found.push_back(c.identity);
    // A device that may not be opened keeps its serial number to itself.
    const auto closed = std::find_if(candidates.begin(), candidates.end(),
                                     [](const Candidate& c) { return c.open_error == LIBUSB_ERROR_ACCESS; });
    auto chosen = choose_instrument(found, choice_, last_, what_, where_);
    if (!chosen && closed != candidates.end() && choice_.serial)
      return no_permission(
          what_, where_,
          fmt::format("{} at port {}", usb_id(closed->identity.vendor, closed->identity.product),
                      closed->identity.port));
    if (!chosen) return tl::unexpected(std::move(chosen.error()));
    return open(candidates[*chosen]);
  }();
  for (Candidate& c : candidates)
    if (c.handle) libusb_close(c.handle);
  libusb_free_device_list(list, 1);
  return result;
}

Result<std::unique_ptr<Transport>> UsbFinder::open(Candidate& chosen) {
  const std::string node = fmt::format("/dev/bus/usb/{:03}/{:03} ({})", libusb_get_bus_number(chosen.device),
                                       libusb_get_device_address(chosen.device),
                                       usb_id(chosen.identity.vendor, chosen.identity.product));
  if (chosen.open_error == LIBUSB_ERROR_ACCESS) return no_permission(what_, where_, node);
  if (chosen.open_error != 0)
    return fail(ErrorCode::kInternal, failed(), where_,
                fmt::format("{}: {}", node, libusb_strerror(static_cast<libusb_error>(chosen.open_error))));
  libusb_config_descriptor* config = nullptr;
  if (const int error = libusb_get_active_config_descriptor(chosen.device, &config); error != 0)
    return bad_input(failed(), where_,
                     fmt::format("{}: its descriptors cannot be read: {}", node,
                                 libusb_strerror(static_cast<libusb_error>(error))));
  const auto endpoints = endpoints_of(*config);
  libusb_free_config_descriptor(config);
  if (!endpoints) return bad_input(failed(), where_, fmt::format("{}: {}", node, endpoints.error()));
  if (const int error = libusb_claim_interface(chosen.handle, 0); error != 0)
    return fail(ErrorCode::kInternal, failed(), where_,
                error == LIBUSB_ERROR_BUSY
                    ? fmt::format("{} is in use by another program", node)
                    : fmt::format("{}: {}", node, libusb_strerror(static_cast<libusb_error>(error))));
  const std::string described(reinterpret_cast<const char*>(&chosen.descriptor), sizeof chosen.descriptor);
  libusb_device_handle* handle = std::exchange(chosen.handle, nullptr);
  last_ = chosen.identity;
  return std::make_unique<UsbTransport>(context_, handle, *endpoints, chosen.identity, described, clock_);
}

}  // namespace

Result<std::unique_ptr<TransportFinder>> find_usb(std::vector<UsbProduct> products, InstrumentChoice choice,
                                                  std::string what, std::string where, Clock& clock) {
  libusb_context* context = nullptr;
  if (const int error = libusb_init(&context); error != 0)
    return fail(ErrorCode::kInternal, "cannot open " + what, where,
                fmt::format("libusb does not start: {}", libusb_strerror(static_cast<libusb_error>(error))));
  return std::make_unique<UsbFinder>(context, std::move(products), std::move(choice), std::move(what),
                                     std::move(where), clock);
}

}  // namespace gnathion
