#include "tests/support/mock_usb.h"

#include <fmt/format.h>
#include <linux/hidraw.h>
#include <linux/usb/ch9.h>
#include <linux/usbdevice_fs.h>
#include <sys/ioctl.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>

#include "core/check.h"

namespace gnathion::mock {
namespace {

using std::chrono::milliseconds;

/// A request that finds nothing is answered "try again" after this long, so that the polling above it does
/// not spin: the files that stand for device nodes are always ready.
constexpr milliseconds kPolitePause{1};
constexpr const char* kBus = "/devices/pci0000:00/0000:00:14.0/usb1";

std::string hex(const std::string& bytes) {
  std::string out;
  for (const char c : bytes) out += fmt::format("{:02X}", static_cast<unsigned char>(c));
  return out;
}

std::string le16(unsigned v) {
  return {static_cast<char>(v & 0xff), static_cast<char>(v >> 8)};
}

void add(UMockdevTestbed* bed, const std::string& description) {
  GError* error = nullptr;
  if (!umockdev_testbed_add_from_string(bed, description.c_str(), &error)) g_error("%s", error->message);
}

void remove(UMockdevTestbed* bed, const std::string& syspath) {
  umockdev_testbed_uevent(bed, syspath.c_str(), "remove");
  umockdev_testbed_remove_device(bed, syspath.c_str());
}

}  // namespace

Bed::Bed() : bed_(umockdev_testbed_new()) {
  GNATHION_CHECK(umockdev_in_mock_environment());
}
Bed::~Bed() {
  g_object_unref(bed_);
}
std::string Bed::root() const {
  gchar* dir = umockdev_testbed_get_root_dir(bed_);
  std::string copy(dir);
  g_free(dir);
  return copy;
}

void Bed::share(const std::string& path, const std::string& description) {
  if (shared_[path]++ == 0) add(bed_, "P: " + path + "\n" + description);
}
void Bed::release(const std::string& path) {
  if (--shared_[path] == 0) remove(bed_, "/sys" + path);
}

Node::Node(Bed& bed) : bed_(bed), handler_(umockdev_ioctl_base_new()) {
  g_signal_connect(handler_, "handle-ioctl", G_CALLBACK(&Node::ioctl_signal), this);
  g_signal_connect(handler_, "handle-read", G_CALLBACK(&Node::read_signal), this);
}
Node::~Node() {
  g_object_unref(handler_);
}

/// No request reaches this object any more; before its derived part goes.
void Node::silence() {
  g_signal_handlers_disconnect_by_data(handler_, this);
  {
    const std::lock_guard lock(mutex_);  // the last one is through
  }
  for (const std::string& node : nodes_) umockdev_testbed_detach_ioctl(bed_.get(), node.c_str(), nullptr);
}

bool Node::is_current(UMockdevIoctlClient* client) const {
  return !gone_ && node_ == umockdev_ioctl_client_get_devnode(client);
}

int Node::ioctl_signal(UMockdevIoctlBase*, UMockdevIoctlClient* client, Node* self) {
  return self->on_ioctl(client);
}
int Node::read_signal(UMockdevIoctlBase*, UMockdevIoctlClient* client, Node* self) {
  return self->on_read(client);
}

/// One report a read; nothing there: EAGAIN, which hidapi takes for "no report yet".
bool Node::on_read(UMockdevIoctlClient* client) {
  UMockdevIoctlData* buffer = umockdev_ioctl_client_get_arg(client);
  std::unique_lock lock(mutex_);
  if (queue_.empty() && !gone_)
    changed_.wait_for(lock, kPolitePause, [&] { return !queue_.empty() || gone_; });
  if (!is_current(client))
    return answer(client, -1, EIO), true;  // as hidraw answers once the device has gone
  if (queue_.empty()) return answer(client, -1, EAGAIN), true;
  Item item = std::move(queue_.front());
  queue_.pop_front();
  if (queue_.empty()) changed_.notify_all();
  if (item.status != 0) return answer(client, -1, -item.status), true;
  const int n = std::min(static_cast<int>(item.bytes.size()), buffer->data_len);
  umockdev_ioctl_data_update(buffer, 0, reinterpret_cast<guint8*>(item.bytes.data()), n);
  return answer(client, n), true;
}

void Node::attach(const std::string& node) {
  GError* error = nullptr;
  if (!umockdev_testbed_attach_ioctl(bed_.get(), node.c_str(), handler_, &error))
    g_error("%s", error->message);
}

void Node::answer(UMockdevIoctlClient* client, long result, int error) {
  umockdev_ioctl_client_complete(client, result, error);
}

/// Handler and client share one address space: the request's pointer is good here.
void* Node::argument(UMockdevIoctlClient* client) {
  void* pointer = nullptr;
  std::memcpy(&pointer, umockdev_ioctl_client_get_arg(client)->data, sizeof pointer);
  return pointer;
}

void Node::push(std::string bytes, int status) {
  const std::lock_guard lock(mutex_);
  queue_.push_back({std::move(bytes), status});
  changed_.notify_all();
}

bool Node::drained(double seconds) {
  std::unique_lock lock(mutex_);
  return changed_.wait_for(lock, std::chrono::duration<double>(seconds), [&] { return queue_.empty(); });
}

Usb::Usb(Bed& bed, UsbSpec spec) : Node(bed), spec_(std::move(spec)) {}

Usb::~Usb() {
  if (!gone_) unplug();
  silence();
}

std::string Usb::descriptors() const {
  std::string d{18, USB_DT_DEVICE};
  d += le16(0x0200) + std::string{'\0', '\0', '\0', 64} + le16(spec_.vendor) + le16(spec_.product) +
       le16(0x0100);
  d += std::string{1, 2, static_cast<char>(spec_.serial.empty() ? 0 : 3), 1};
  if (!spec_.configuration.empty()) return d + spec_.configuration;
  std::string face{
      9, USB_DT_INTERFACE, 0, 0, static_cast<char>(spec_.endpoints), static_cast<char>(0xff), 0, 0, 0};
  const auto endpoint = [&](std::uint8_t address, std::uint8_t attributes) {
    face += std::string{7, USB_DT_ENDPOINT, static_cast<char>(address), static_cast<char>(attributes)} +
            le16(spec_.packet) + std::string(1, '\0');
  };
  if (spec_.endpoints > 0) endpoint(spec_.out, spec_.out_attributes);
  if (spec_.endpoints > 1) endpoint(spec_.in, spec_.in_attributes);
  return d + std::string{9, USB_DT_CONFIG} + le16(9 + static_cast<unsigned>(face.size())) +
         std::string{1, 1, 0, static_cast<char>(0x80), 50} + face;
}

void Usb::plug() {
  const int number = bed_.fresh_number();
  {
    const std::lock_guard lock(mutex_);
    node_ = fmt::format("/dev/bus/usb/001/{:03}", number);
    gone_ = false;
    halted_ = false;
    waiting_.clear();
    ended_.clear();
  }
  attach(node_);
  add(bed_.get(),
      fmt::format(
          "P: {0}/{1}\nN: bus/usb/001/{2:03}\nE: SUBSYSTEM=usb\nE: DRIVER=usb\nE: DEVTYPE=usb_device\n"
          "E: DEVNAME=/dev/bus/usb/001/{2:03}\nE: BUSNUM=001\nE: DEVNUM={2:03}\n"
          "E: PRODUCT={3:x}/{4:x}/100\nA: busnum=1\\n\nA: devnum={2}\\n\nA: speed=480\\n\n"
          "A: bConfigurationValue=1\\n\nA: idVendor={3:04x}\\n\nA: idProduct={4:04x}\\n\n"
          "H: descriptors={5}\n",
          kBus, spec_.port, number, spec_.vendor, spec_.product, hex(descriptors())));
  syspath_ = fmt::format("/sys{}/{}", kBus, spec_.port);
}

void Usb::unplug() {
  {
    const std::lock_guard lock(mutex_);
    gone_ = true;
    for (void* pointer : waiting_) {
      static_cast<usbdevfs_urb*>(pointer)->status = -ESHUTDOWN;
      ended_.push_back(pointer);
    }
    waiting_.clear();
    queue_.clear();
    changed_.notify_all();
  }
  remove(bed_.get(), syspath_);
}

void Usb::fail_writes(int status) {
  const std::lock_guard lock(mutex_);
  write_status_ = status;
}
void Usb::fail_claim(int error) {
  const std::lock_guard lock(mutex_);
  claim_error_ = error;
}
int Usb::halts_cleared() {
  const std::lock_guard lock(mutex_);
  return halts_cleared_;
}
std::vector<std::string> Usb::written() {
  const std::lock_guard lock(mutex_);
  return written_;
}

bool Usb::on_ioctl(UMockdevIoctlClient* client) {
  const unsigned long request = umockdev_ioctl_client_get_request(client);
  if (request == USBDEVFS_REAPURB || request == USBDEVFS_REAPURBNDELAY) return reap(client);
  std::unique_lock lock(mutex_);
  if (!is_current(client) && request != USBDEVFS_DISCARDURB) return answer(client, -1, ENODEV), true;
  switch (request) {
    case USBDEVFS_GET_CAPABILITIES:
      *static_cast<std::uint32_t*>(argument(client)) =
          USBDEVFS_CAP_NO_PACKET_SIZE_LIM | USBDEVFS_CAP_REAP_AFTER_DISCONNECT;
      answer(client, 0);
      return true;
    case USBDEVFS_CLAIMINTERFACE:
      if (claim_error_)
        answer(client, -1, claim_error_);
      else
        answer(client, 0);
      return true;
    case USBDEVFS_CLEAR_HALT:
      ++halts_cleared_;
      halted_ = false;
      [[fallthrough]];
    case USBDEVFS_RELEASEINTERFACE:
    case USBDEVFS_RESET:
      answer(client, 0);
      return true;
    case USBDEVFS_SUBMITURB: {
      void* urb = argument(client);
      lock.unlock();
      submit(urb);
      answer(client, 0);
      return true;
    }
    case USBDEVFS_DISCARDURB: {
      const auto found = std::find(waiting_.begin(), waiting_.end(), argument(client));
      if (found == waiting_.end()) return answer(client, -1, EINVAL), true;
      static_cast<usbdevfs_urb*>(*found)->status = -ENOENT;
      static_cast<usbdevfs_urb*>(*found)->actual_length = 0;
      ended_.push_back(*found);
      waiting_.erase(found);
      answer(client, 0);
      return true;
    }
    default:
      answer(client, -1, ENOTTY);
      return true;
  }
}

void Usb::submit(void* pointer) {
  auto* urb = static_cast<usbdevfs_urb*>(pointer);
  urb->actual_length = 0;
  if (urb->type == USBDEVFS_URB_TYPE_CONTROL) return answer_control(urb);
  if (urb->endpoint & USB_DIR_IN) {
    const std::lock_guard lock(mutex_);
    waiting_.push_back(urb);
    return match();
  }
  const std::string bytes(static_cast<char*>(urb->buffer), static_cast<std::size_t>(urb->buffer_length));
  int status = 0;
  {
    const std::lock_guard lock(mutex_);
    status = write_status_;
    urb->status = status;
    urb->actual_length = status ? 0 : urb->buffer_length;
    if (status == 0) written_.push_back(bytes);
  }
  if (status == 0 && on_write) on_write(bytes);
  const std::lock_guard lock(mutex_);
  ended_.push_back(urb);
}

/// String descriptors: manufacturer 1, product 2, serial number 3.
void Usb::answer_control(void* pointer) {
  auto* urb = static_cast<usbdevfs_urb*>(pointer);
  const auto* setup = static_cast<const std::uint8_t*>(urb->buffer);
  const std::lock_guard lock(mutex_);
  urb->status = -EPIPE;
  if (setup[0] == USB_DIR_IN && setup[1] == USB_REQ_GET_DESCRIPTOR && setup[3] == USB_DT_STRING) {
    const std::vector<std::string> texts = {"", "Polhemus", "Tracker", spec_.serial};
    std::string d = le16(0x0409);
    if (setup[2] != 0) {
      d.clear();
      for (const char c : texts.at(setup[2])) d += le16(static_cast<unsigned char>(c));
    }
    d = std::string{static_cast<char>(2 + d.size()), USB_DT_STRING} + d;
    const std::size_t wanted = setup[6] | (std::size_t{setup[7]} << 8);
    d.resize(std::min(d.size(), wanted));
    std::memcpy(static_cast<char*>(urb->buffer) + 8, d.data(), d.size());
    urb->actual_length = static_cast<int>(d.size());
    urb->status = 0;
  } else if (on_control && (setup[0] & 0x60) != 0) {  // bits 5 and 6: class or vendor
    auto* bytes = static_cast<char*>(urb->buffer);
    const bool in = (setup[0] & USB_DIR_IN) != 0;
    const auto room = static_cast<std::size_t>(std::max(0, urb->buffer_length - 8));
    const auto answered = on_control({bytes, 8}, in ? std::string() : std::string(bytes + 8, room));
    if (answered) {
      const std::size_t count = in ? std::min(answered->size(), room) : room;
      if (in) std::memcpy(bytes + 8, answered->data(), count);
      urb->actual_length = static_cast<int>(count);
      urb->status = 0;
    }
  }
  ended_.push_back(urb);
}

/// Hands queued bytes to waiting reads, one item a read.
void Usb::match() {
  while (!waiting_.empty() && !queue_.empty() && !halted_) {
    auto* urb = static_cast<usbdevfs_urb*>(waiting_.front());
    waiting_.pop_front();
    const Item item = std::move(queue_.front());
    queue_.pop_front();
    GNATHION_CHECK(static_cast<int>(item.bytes.size()) <= urb->buffer_length);
    std::memcpy(urb->buffer, item.bytes.data(), item.bytes.size());
    urb->actual_length = static_cast<int>(item.bytes.size());
    urb->status = item.status;
    halted_ = item.status == -EPIPE;
    ended_.push_back(urb);
  }
  if (queue_.empty()) changed_.notify_all();
}

bool Usb::reap(UMockdevIoctlClient* client) {
  std::unique_lock lock(mutex_);
  if (!gone_ && !is_current(client))
    return answer(client, -1, ENODEV), true;  // another one is plugged in now
  if (ended_.empty() && !gone_ && !halted_ && queue_.empty() && on_idle && !waiting_.empty()) {
    std::string bytes =
        on_idle();  // locked: what it gives away reaches the driver, also if the cable goes next
    if (!bytes.empty()) queue_.push_back({std::move(bytes), 0});
  }
  if (ended_.empty() && queue_.empty() && !gone_)
    changed_.wait_for(lock, kPolitePause, [&] { return !queue_.empty() || gone_; });
  match();
  if (ended_.empty()) return answer(client, -1, is_current(client) ? EAGAIN : ENODEV), true;
  *static_cast<void**>(argument(client)) = ended_.front();
  ended_.pop_front();
  answer(client, 0);
  return true;
}

Hid::Hid(Bed& bed, HidSpec spec) : Node(bed), spec_(std::move(spec)) {}

Hid::~Hid() {
  if (!gone_) unplug();
  silence();
}

void Hid::plug() {
  const int number = bed_.fresh_number();
  const std::string usb = fmt::format("{}/{}", kBus, spec_.port);
  const std::string face = fmt::format("{}/{}:1.{}", usb, spec_.port, spec_.interface);
  const std::string hid =
      fmt::format("{}/0003:{:04X}:{:04X}.{:04X}", face, spec_.vendor, spec_.product, number);
  const std::string raw = fmt::format("{}/hidraw/hidraw{}", hid, number);
  {
    const std::lock_guard lock(mutex_);
    node_ = fmt::format("/dev/hidraw{}", number);
    gone_ = false;
  }
  attach(node_);
  bed_.share(usb, fmt::format("E: SUBSYSTEM=usb\nE: DEVTYPE=usb_device\nA: manufacturer=Maker\\n\n"
                              "A: product={}\\n\nA: idVendor={:04x}\\n\nA: idProduct={:04x}\\n\n",
                              spec_.name, spec_.vendor, spec_.product));
  add(bed_.get(),
      fmt::format("P: {}\nE: SUBSYSTEM=usb\nE: DEVTYPE=usb_interface\nA: bInterfaceNumber={:02x}\\n\n", face,
                  spec_.interface));
  add(bed_.get(), fmt::format("P: {}\nE: SUBSYSTEM=hid\nE: HID_ID=0003:{:08X}:{:08X}\nE: HID_NAME={}\n"
                              "E: HID_PHYS=usb-{}/input0\nE: HID_UNIQ={}\nH: report_descriptor={}\n",
                              hid, spec_.vendor, spec_.product, spec_.name, spec_.port, spec_.serial,
                              hex(spec_.report_descriptor)));
  add(bed_.get(),
      fmt::format("P: {}\nN: hidraw{}\nE: SUBSYSTEM=hidraw\nE: DEVNAME=/dev/hidraw{}\nL: device=../..\n", raw,
                  number, number));
  // The node is a terminal underneath: a line that nobody takes keeps it readable, so that poll() leads to
  // read().
  const int other_end = umockdev_testbed_get_dev_fd(bed_.get(), node_.c_str());
  GNATHION_CHECK(other_end >= 0 && ::write(other_end, "\n", 1) == 1);
  paths_ = {usb, face, hid, raw};
}

void Hid::unplug() {
  {
    const std::lock_guard lock(mutex_);
    gone_ = true;
    queue_.clear();
    changed_.notify_all();
  }
  std::filesystem::remove(bed_.root() + node_);
  while (paths_.size() > 1) {
    remove(bed_.get(), "/sys" + paths_.back());
    paths_.pop_back();
  }
  bed_.release(paths_.front());
}

bool Hid::on_ioctl(UMockdevIoctlClient* client) {
  const unsigned long request = umockdev_ioctl_client_get_request(client);
  const std::lock_guard lock(mutex_);
  if (!is_current(client)) return answer(client, -1, ENODEV), true;
  if (request == HIDIOCGRDESCSIZE) {
    *static_cast<int*>(argument(client)) = static_cast<int>(spec_.report_descriptor.size());
    return answer(client, 0), true;
  }
  return answer(client, -1, ENOTTY), true;
}

}  // namespace gnathion::mock
