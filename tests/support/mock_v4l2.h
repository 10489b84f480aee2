// A V4L2 camera made of umockdev, for the real OpenCV: answers the driver's requests and writes frames into
// the memory that OpenCV maps (the file that stands for the device node). The test runs under
// umockdev-wrapper.
#pragma once

#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/mman.h>
#include <time.h>
#include <umockdev.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <deque>
#include <functional>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/check.h"
#include "tests/support/numbered_image.h"

namespace gnathion::test {

class MockV4l2 {
 public:
  struct Control {
    int low, high, value;
    bool stuck = false;  ///< takes every value and keeps its own
    int step = 1;
  };
  explicit MockV4l2(UMockdevTestbed* bed) : bed_(bed), handler_(umockdev_ioctl_base_new()) {
    g_signal_connect(handler_, "handle-ioctl",
                     G_CALLBACK(+[](UMockdevIoctlBase*, UMockdevIoctlClient* client,
                                    MockV4l2* self) -> gboolean { return self->answer(client); }),
                     this);
  }
  ~MockV4l2() {
    unplug();
    g_signal_handlers_disconnect_by_data(handler_, this);
    g_object_unref(handler_);
  }
  MockV4l2(const MockV4l2&) = delete;
  MockV4l2& operator=(const MockV4l2&) = delete;

  std::map<std::uint32_t, Control> controls;
  std::vector<unsigned> rates_hz = {15, 30, 60};
  /// Frames that the driver drops: their time passes, they do not come.
  std::function<bool(unsigned)> dropped = [](unsigned) { return false; };

  void plug() {
    if (path_.empty()) add_to_testbed();
    // umockdev makes a terminal of a character device; but memory can be mapped of a file only.
    const int file = ::open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0660);
    GNATHION_CHECK(file >= 0 && ::ftruncate(file, kBuffers * kBufferBytes) == 0);
    memory_ = static_cast<std::uint8_t*>(
        ::mmap(nullptr, kBuffers * kBufferBytes, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0));
    ::close(file);
    GNATHION_CHECK(memory_ != MAP_FAILED);
    const std::lock_guard lock(mutex_);
    gone_ = false;
  }
  /// The node goes, and who has it open gets ENODEV.
  void unplug() {
    const std::lock_guard lock(mutex_);
    if (gone_) return;
    gone_ = true;
    ::munmap(memory_, kBuffers * kBufferBytes);
    ::unlink(path_.c_str());
  }

 private:
  static constexpr const char* kNode = "/dev/video0";
  static constexpr int kBuffers = 8;
  static constexpr std::size_t kBufferBytes = 19 * 4096;  // whole pages, as drivers align them

  void add_to_testbed() {
    GError* error = nullptr;
    umockdev_testbed_attach_ioctl(bed_, kNode, handler_, &error);
    GNATHION_CHECK(!error);
    umockdev_testbed_add_from_string(
        bed_,
        "P: /devices/pci0000:00/usb1/1-1/1-1:1.0/video4linux/video0\nN: video0\n"
        "E: SUBSYSTEM=video4linux\nE: DEVNAME=/dev/video0\nA: name=Mock Bow Camera\\n\n",
        &error);
    GNATHION_CHECK(!error);
    gchar* root = umockdev_testbed_get_root_dir(bed_);
    path_ = std::string(root) + kNode;
    g_free(root);
    ::unlink(path_.c_str());
  }

  gboolean answer(UMockdevIoctlClient* client) {
    void* argument = nullptr;  // handler and client share one address space
    std::memcpy(&argument, umockdev_ioctl_client_get_arg(client)->data, sizeof argument);
    const std::lock_guard lock(mutex_);
    const int error = gone_ ? ENODEV : request(umockdev_ioctl_client_get_request(client), argument);
    umockdev_ioctl_client_complete(client, error ? -1 : 0, error);
    return true;
  }

  int request(unsigned long code, void* p) {
    switch (code) {
      case VIDIOC_QUERYCAP: {
        auto& c = *static_cast<v4l2_capability*>(p);
        c = {};
        std::strcpy(reinterpret_cast<char*>(c.driver), "mock");
        std::strcpy(reinterpret_cast<char*>(c.card), "Mock Bow Camera");
        c.device_caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
        c.capabilities = c.device_caps | V4L2_CAP_DEVICE_CAPS;
        return 0;
      }
      case VIDIOC_S_INPUT:
        return 0;
      case VIDIOC_G_FMT:
      case VIDIOC_S_FMT:
      case VIDIOC_TRY_FMT: {
        auto& pix = static_cast<v4l2_format*>(p)->fmt.pix;
        pix = {};
        pix.width = 320;
        pix.height = 240;
        pix.pixelformat = V4L2_PIX_FMT_GREY;
        pix.field = V4L2_FIELD_NONE;
        pix.bytesperline = 320;
        pix.sizeimage = 320 * 240;
        return 0;
      }
      case VIDIOC_G_PARM:
      case VIDIOC_S_PARM:
        return rate(code, &static_cast<v4l2_streamparm*>(p)->parm.capture);
      case VIDIOC_REQBUFS: {
        auto& r = *static_cast<v4l2_requestbuffers*>(p);
        if (r.memory != V4L2_MEMORY_MMAP) return EINVAL;
        r.count = std::min<std::uint32_t>(r.count, kBuffers);
        return 0;
      }
      case VIDIOC_QUERYBUF: {
        auto& b = *static_cast<v4l2_buffer*>(p);
        b.length = 320 * 240;
        b.m.offset = static_cast<std::uint32_t>(b.index * kBufferBytes);
        return 0;
      }
      case VIDIOC_QBUF:
        queued_.push_back(static_cast<v4l2_buffer*>(p)->index);
        return 0;
      case VIDIOC_DQBUF:
        return frame(static_cast<v4l2_buffer*>(p));
      case VIDIOC_STREAMON:
        begin_ = std::chrono::steady_clock::now();
        number_ = 0;
        return 0;
      case VIDIOC_STREAMOFF:
        queued_.clear();
        return 0;
      default:
        return control(code, p);
    }
  }

  int rate(unsigned long code, v4l2_captureparm* parm) {
    if (code == VIDIOC_S_PARM) {
      const double asked = static_cast<double>(parm->timeperframe.denominator) / parm->timeperframe.numerator;
      rate_hz_ = rates_hz.front();
      for (const unsigned r : rates_hz)
        if (r <= asked + 1e-9) rate_hz_ = r;
    }
    *parm = {};
    parm->capability = V4L2_CAP_TIMEPERFRAME;
    parm->timeperframe = {1, rate_hz_};
    return 0;
  }

  int control(unsigned long code, void* p) {
    if (code == VIDIOC_QUERYCTRL) {
      auto& q = *static_cast<v4l2_queryctrl*>(p);
      const auto found = controls.find(q.id);
      if (found == controls.end()) return EINVAL;
      q.type = V4L2_CTRL_TYPE_INTEGER;
      q.minimum = found->second.low;
      q.maximum = found->second.high;
      q.step = found->second.step;
      q.flags = 0;
      return 0;
    }
    if (code != VIDIOC_G_CTRL && code != VIDIOC_S_CTRL) return ENOTTY;
    auto& c = *static_cast<v4l2_control*>(p);
    const auto found = controls.find(c.id);
    if (found == controls.end()) return EINVAL;
    Control& k = found->second;
    if (code == VIDIOC_G_CTRL) return c.value = k.value, 0;
    if (!k.stuck) k.value = std::clamp(c.value / k.step * k.step, k.low, k.high);
    return 0;
  }

  int frame(v4l2_buffer* b) {
    if (queued_.empty()) return EAGAIN;
    while (dropped(number_)) ++number_;
    const auto at = begin_ + std::chrono::duration<double>(number_ / static_cast<double>(rate_hz_));
    std::this_thread::sleep_until(at);
    b->index = queued_.front();
    queued_.pop_front();
    const cv::Mat image = numbered_image(number_);
    std::memcpy(memory_ + b->index * kBufferBytes, image.data, 320 * 240);
    b->bytesused = b->length = 320 * 240;
    b->flags = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    const auto stamp_us =
        std::chrono::duration_cast<std::chrono::microseconds>(at.time_since_epoch()).count();
    b->timestamp = {stamp_us / 1'000'000, stamp_us % 1'000'000};
    b->sequence = number_++;
    b->m.offset = static_cast<std::uint32_t>(b->index * kBufferBytes);
    return 0;
  }

  UMockdevTestbed* bed_;
  std::string path_;  ///< of the file that stands for the node
  UMockdevIoctlBase* handler_;
  std::mutex mutex_;
  bool gone_ = true;
  std::uint8_t* memory_ = nullptr;
  std::deque<std::uint32_t> queued_;
  unsigned rate_hz_ = 30, number_ = 0;
  std::chrono::steady_clock::time_point begin_;
};

}  // namespace gnathion::test
