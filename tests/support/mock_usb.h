// USB and HID devices made of umockdev, for the real libusb and hidapi: a small kernel side that takes
// requests and answers them as usbfs and hidraw do. The test program runs under umockdev-wrapper.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

struct _UMockdevTestbed;
struct _UMockdevIoctlBase;
struct _UMockdevIoctlClient;

namespace gnathion::mock {

/// The sysfs and /dev of this process. One for the program.
class Bed {
 public:
  Bed();
  ~Bed();
  _UMockdevTestbed* get() const { return bed_; }
  std::string root() const;
  /// A device number that was not used before.
  int fresh_number() { return ++numbers_; }
  /// A device of sysfs that several interfaces may have in common; it goes with the last of them.
  void share(const std::string& path, const std::string& description);
  void release(const std::string& path);

 private:
  _UMockdevTestbed* bed_;
  int numbers_ = 1;
  std::map<std::string, int> shared_;
};

/// What both kinds share: a node with a handler behind it. Answers come from umockdev's thread.
class Node {
 public:
  explicit Node(Bed& bed);
  virtual ~Node();
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;
  virtual void plug() = 0;
  virtual void unplug() = 0;
  /// The next thing that the device delivers: bytes, or a negative errno (bytes may come with it).
  void push(std::string bytes, int status = 0);
  /// True once everything pushed was fetched by the driver, or not within `seconds`.
  bool drained(double seconds = 20);

 protected:
  struct Item {
    std::string bytes;
    int status = 0;
  };
  void attach(const std::string& node);
  void silence();
  virtual bool on_ioctl(_UMockdevIoctlClient* client) = 0;
  bool on_read(_UMockdevIoctlClient* client);
  static void answer(_UMockdevIoctlClient* client, long result, int error = 0);
  /// False for a file of an earlier plugging: that device is gone for good.
  bool is_current(_UMockdevIoctlClient* client) const;
  static void* argument(_UMockdevIoctlClient* client);

  Bed& bed_;
  _UMockdevIoctlBase* handler_;
  std::string node_;
  std::vector<std::string> nodes_;  ///< all that ever were: files on them may still be open
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Item> queue_;
  bool gone_ = true;

 private:
  static int ioctl_signal(_UMockdevIoctlBase*, _UMockdevIoctlClient* client, Node* self);
  static int read_signal(_UMockdevIoctlBase*, _UMockdevIoctlClient* client, Node* self);
};

struct UsbSpec {
  std::uint16_t vendor = 0x0f44, product = 0xff20;
  std::string serial, port = "1-1";
  std::uint8_t in = 0x88, out = 0x04, in_attributes = 2, out_attributes = 2;
  std::uint16_t packet = 512;
  int endpoints = 2;          ///< how many the interface has; its descriptor says so too
  std::string configuration;  ///< replaces the whole configuration descriptor
};

/// A device with one bulk endpoint of each direction, as usbfs shows it.
class Usb : public Node {
 public:
  Usb(Bed& bed, UsbSpec spec);
  ~Usb() override;
  void plug() override;
  void unplug() override;
  /// Bytes that came on the bulk OUT endpoint; called on umockdev's thread, may push().
  std::function<void(const std::string&)> on_write;
  /// Called when a read waits and nothing is queued; may return bytes. Must not push().
  std::function<std::string()> on_idle;
  /// Class and vendor requests: the 8 setup bytes and what is sent; returns what is read, or nothing for a
  /// stall.
  std::function<std::optional<std::string>(const std::string& setup, const std::string& data)> on_control;
  void fail_writes(int status);  ///< 0: writes work
  void fail_claim(int error);
  int halts_cleared();
  std::vector<std::string> written();
  std::string node() const { return node_; }

 protected:
  bool on_ioctl(_UMockdevIoctlClient* client) override;

 private:
  void submit(void* urb);
  void answer_control(void* urb);
  bool reap(_UMockdevIoctlClient* client);
  void match();
  std::string descriptors() const;

  UsbSpec spec_;
  std::string syspath_;
  std::deque<void*> waiting_, ended_;  ///< struct usbdevfs_urb of the client
  std::vector<std::string> written_;
  bool halted_ = false;  ///< after a stall nothing moves until the halt is cleared
  int write_status_ = 0, claim_error_ = 0, halts_cleared_ = 0;
};

struct HidSpec {
  std::uint16_t vendor = 0x05f3, product = 0x00ff;
  std::string name = "VEC USB Footpedal", serial, port = "1-2", report_descriptor;
  int interface = 0;
};

/// A HID interface, as hidraw shows it.
class Hid : public Node {
 public:
  Hid(Bed& bed, HidSpec spec);
  ~Hid() override;
  void plug() override;
  void unplug() override;
  std::string node() const { return node_; }

 protected:
  bool on_ioctl(_UMockdevIoctlClient* client) override;

 private:
  HidSpec spec_;
  std::vector<std::string> paths_;  ///< outermost first
};

}  // namespace gnathion::mock
