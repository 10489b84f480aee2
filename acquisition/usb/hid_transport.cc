#include "acquisition/usb/hid_transport.h"

#include <fmt/format.h>
#include <hidapi/hidapi.h>
#include <poll.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cwchar>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <mutex>

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;

/// hidapi 0.13 keeps the last error of enumerating and opening in one place for the whole process.
std::mutex& hidapi_mutex() {
  static std::mutex mutex;
  return mutex;
}

std::string narrow(const wchar_t* text) {
  std::string out;
  for (; text && *text; ++text) out += *text < 0x80 ? static_cast<char>(*text) : '?';
  return out;
}

/// hidapi 0.13 does not hand out report descriptors; the kernel does, to everyone.
std::string report_descriptor_of(const std::string& node) {
  const fs::path file =
      fs::path("/sys/class/hidraw") / fs::path(node).filename() / "device" / "report_descriptor";
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>()};
}

/// The USB port in a hidraw node's path in sysfs: ".../1-2.3/1-2.3:1.0/0003:…".
std::string port_of(const std::string& node) {
  std::error_code ignored;
  const fs::path device =
      fs::canonical(fs::path("/sys/class/hidraw") / fs::path(node).filename() / "device", ignored);
  std::string port;
  for (const fs::path& part : device)
    if (const std::string name = part.string(); name.find('-') != std::string::npos)
      if (const auto colon = name.find(':'); colon != std::string::npos && colon > name.find('-'))
        port = name.substr(0, colon);
  return port;
}

bool exists(const std::string& node) {
  return ::access(node.c_str(), F_OK) == 0;
}

class HidTransport : public Transport {
 public:
  HidTransport(hid_device* device, std::string node, InstrumentIdentity identity, std::string descriptor,
               Clock& clock)
      : device_(device),
        node_(std::move(node)),
        identity_(std::move(identity)),
        descriptors_{kDescriptorEndpoint, kTransferOk, std::move(descriptor), clock.now()},
        clock_(clock) {}
  ~HidTransport() override {
    const std::lock_guard lock(hidapi_mutex());
    hid_close(device_);
  }

  std::optional<Transfer> read(milliseconds timeout) override {
    std::array<unsigned char, 4096> report;
    errno = 0;
    const int n = hid_read_timeout(device_, report.data(), report.size(), static_cast<int>(timeout.count()));
    const int error = errno;
    if (n == 0) return std::nullopt;
    if (n > 0)
      return Transfer{0, kTransferOk,
                      std::string(reinterpret_cast<char*>(report.data()), static_cast<std::size_t>(n)),
                      clock_.now()};
    return Transfer{0, status_of(error), {}, clock_.now()};
  }

  Transfer write(std::string_view) override { return {0, kTransferOther, {}, clock_.now()}; }
  Transfer descriptors() const override { return descriptors_; }
  const InstrumentIdentity& identity() const override { return identity_; }

 private:
  /// hidraw fails with EIO once the device has gone, and poll() then fails without an error number.
  TransferStatus status_of(int error) const {
    if (error == ENODEV || error == EIO || error == 0 || !exists(node_)) return kTransferGone;
    if (error == EPIPE) return kTransferStall;
    if (error == EOVERFLOW) return kTransferOverflow;
    if (error == ETIMEDOUT) return kTransferTimeout;
    return kTransferIo;
  }

  hid_device* device_;
  std::string node_;
  InstrumentIdentity identity_;
  Transfer descriptors_;
  Clock& clock_;
};

class HidFinder : public TransportFinder {
 public:
  HidFinder(std::vector<HidProduct> products, InstrumentChoice choice,
            std::function<Status(const std::string&)> fits, std::string what, std::string where, Clock& clock)
      : products_(std::move(products)),
        choice_(std::move(choice)),
        fits_(std::move(fits)),
        what_(std::move(what)),
        where_(std::move(where)),
        clock_(clock) {}
  Result<std::unique_ptr<Transport>> open() override;
  void wait_for_change(milliseconds timeout) override {
    ::poll(nullptr, 0, static_cast<int>(timeout.count()));  // hidapi tells of no arrivals
  }

 private:
  struct Interface {
    std::string node, descriptor;
    int number = 0;
    InstrumentIdentity identity;
  };
  std::vector<Interface> interfaces() const;
  Result<std::vector<Interface>> fitting() const;

  std::vector<HidProduct> products_;
  InstrumentChoice choice_;
  std::function<Status(const std::string&)> fits_;
  std::string what_, where_;
  Clock& clock_;
  std::optional<InstrumentIdentity> last_;
};

std::vector<HidFinder::Interface> HidFinder::interfaces() const {
  std::vector<Interface> found;
  for (const HidProduct& product : products_) {
    hid_device_info* list = hid_enumerate(product.vendor, product.product);
    for (const hid_device_info* info = list; info; info = info->next) {
      const std::string node = info->path;  // one entry for each of its top-level collections
      if (std::any_of(found.begin(), found.end(), [&](const Interface& i) { return i.node == node; }))
        continue;
      found.push_back({node,
                       report_descriptor_of(node),
                       info->interface_number,
                       {info->vendor_id, info->product_id, narrow(info->manufacturer_string), product.model,
                        narrow(info->serial_number), port_of(node)}});
    }
    hid_free_enumeration(list);
  }
  std::sort(found.begin(), found.end(),
            [](const Interface& a, const Interface& b) { return a.identity.port < b.identity.port; });
  return found;
}

/// One interface of each device: that of the lowest number which fits.
Result<std::vector<HidFinder::Interface>> HidFinder::fitting() const {
  std::vector<Interface> fit;
  std::optional<Error> misfit;
  for (Interface& i : interfaces()) {
    if (choice_.interface && i.number != *choice_.interface) continue;
    Status fits = fits_(i.descriptor);
    if (!fits) {
      misfit = std::move(fits.error());
      continue;
    }
    const auto same = std::find_if(fit.begin(), fit.end(), [&](const Interface& other) {
      return !i.identity.port.empty() && other.identity.port == i.identity.port;
    });
    if (same == fit.end())
      fit.push_back(std::move(i));
    else if (i.number < same->number)
      *same = std::move(i);
  }
  if (fit.empty() && misfit) return in_context("cannot open " + what_, std::move(*misfit));
  return fit;
}

Result<std::unique_ptr<Transport>> HidFinder::open() {
  const std::lock_guard lock(hidapi_mutex());
  GNATHION_TRY(const std::vector<Interface> fit, fitting());
  std::vector<InstrumentIdentity> found;
  for (const Interface& i : fit) found.push_back(i.identity);
  GNATHION_TRY(const std::size_t chosen, choose_instrument(found, choice_, last_, what_, where_));
  const Interface& i = fit[chosen];
  errno = 0;
  hid_device* device = hid_open_path(i.node.c_str());
  const int error = errno;
  if (device) {
    last_ = i.identity;
    return std::make_unique<HidTransport>(device, i.node, i.identity, i.descriptor, clock_);
  }
  const std::string node = fmt::format("{} ({})", i.node, usb_id(i.identity.vendor, i.identity.product));
  if (error == EACCES || error == EPERM) return no_permission(what_, where_, node);
  return fail(ErrorCode::kInternal, "cannot open " + what_, where_,
              fmt::format("{}: {}", node, narrow(hid_error(nullptr))));
}

}  // namespace

std::unique_ptr<TransportFinder> find_hid(std::vector<HidProduct> products, InstrumentChoice choice,
                                          std::function<Status(const std::string& report_descriptor)> fits,
                                          std::string what, std::string where, Clock& clock) {
  return std::make_unique<HidFinder>(std::move(products), std::move(choice), std::move(fits), std::move(what),
                                     std::move(where), clock);
}

}  // namespace gnathion
