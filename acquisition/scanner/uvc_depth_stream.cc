#include "acquisition/scanner/uvc_depth_stream.h"

#include <fmt/format.h>
#include <libusb-1.0/libusb.h>

#include <algorithm>
#include <array>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot open depth camera";
constexpr int kControlTimeout_ms = 2000;
constexpr std::uint8_t kVideoClass = 0x0e, kStreamingSubclass = 0x02;
// VideoStreaming requests and controls (UVC 1.5, table ).
constexpr std::uint8_t kSetCur = 0x01, kGetCur = 0x81;
constexpr std::uint16_t kProbe = 0x0100, kCommit = 0x0200;

std::string text_of(int error) {
  return libusb_strerror(static_cast<libusb_error>(error));
}

struct DepthInterface {
  int number = -1;
  std::uint8_t endpoint = 0;
  bool isochronous = false;
  DepthModes modes;
};

/// The VideoStreaming interface that offers Z16.
Result<DepthInterface> depth_interface(const libusb_config_descriptor& config, const std::string& where) {
  for (int i = 0; i < config.bNumInterfaces; ++i) {
    DepthInterface found;
    for (int a = 0; a < config.interface[i].num_altsetting; ++a) {
      const libusb_interface_descriptor& d = config.interface[i].altsetting[a];
      if (d.bInterfaceClass != kVideoClass || d.bInterfaceSubClass != kStreamingSubclass) continue;
      found.number = d.bInterfaceNumber;
      if (d.extra_length > 0 && found.modes.modes.empty()) {
        GNATHION_TRY(found.modes, parse_depth_modes({reinterpret_cast<const char*>(d.extra),
                                                     static_cast<std::size_t>(d.extra_length)}));
      }
      for (int e = 0; e < d.bNumEndpoints; ++e) {
        const libusb_endpoint_descriptor& endpoint = d.endpoint[e];
        if (!(endpoint.bEndpointAddress & LIBUSB_ENDPOINT_IN)) continue;
        const int type = endpoint.bmAttributes & LIBUSB_TRANSFER_TYPE_MASK;
        if (type == LIBUSB_TRANSFER_TYPE_BULK && a == 0) found.endpoint = endpoint.bEndpointAddress;
        if (type == LIBUSB_TRANSFER_TYPE_ISOCHRONOUS) found.isochronous = true;
      }
    }
    if (!found.modes.modes.empty()) return found;
  }
  return bad_input(kWhat, where, "the camera offers no depth as Z16 over UVC");
}

}  // namespace

struct UvcDepthStream::Usb {
  libusb_context* context = nullptr;
  libusb_device_handle* handle = nullptr;
  int interface = -1;
  bool driver_aside = false;
  DepthInterface depth;

  ~Usb() {
    if (handle && interface >= 0) {
      libusb_release_interface(handle, interface);
      if (driver_aside) libusb_attach_kernel_driver(handle, interface);
    }
    if (handle) libusb_close(handle);
    if (context) libusb_exit(context);
  }

  std::string string_of(std::uint8_t index) const {
    std::array<unsigned char, 256> text{};
    if (index == 0) return {};
    const int n =
        libusb_get_string_descriptor_ascii(handle, index, text.data(), static_cast<int>(text.size()));
    return n > 0 ? std::string(reinterpret_cast<char*>(text.data()), static_cast<std::size_t>(n))
                 : std::string();
  }

  /// Opens the one camera that is meant.
  Status find(const UvcDepthChoice& choice, const std::string& where) {
    if (const int error = libusb_init(&context); error != 0)
      return fail(ErrorCode::kInternal, kWhat, where, text_of(error));
    libusb_device** list = nullptr;
    const ssize_t count = libusb_get_device_list(context, &list);
    int fitting = 0, denied = 0, last_error = 0;
    for (ssize_t i = 0; i < count; ++i) {
      libusb_device_descriptor d{};
      if (libusb_get_device_descriptor(list[i], &d) != 0 || d.idVendor != choice.vendor ||
          d.idProduct != choice.product)
        continue;
      libusb_device_handle* opened = nullptr;
      if (const int error = libusb_open(list[i], &opened); error != 0) {
        denied += error == LIBUSB_ERROR_ACCESS ? 1 : 0;
        last_error = error;
        continue;
      }
      std::swap(handle, opened);  // string_of() reads from `handle`
      const bool fits = choice.serial.empty() || string_of(d.iSerialNumber) == choice.serial;
      if (!fits || fitting > 0) std::swap(handle, opened);
      fitting += fits ? 1 : 0;
      if (opened) libusb_close(opened);
    }
    if (count >= 0) libusb_free_device_list(list, 1);
    const std::string id = fmt::format("{:04x}:{:04x}", choice.vendor, choice.product);
    if (fitting == 1) return {};
    if (fitting > 1)
      return bad_input(kWhat, where, fmt::format("{} cameras {}; 'serial' must tell which", fitting, id));
    if (denied > 0)
      return bad_input(
          kWhat, where,
          fmt::format("no permission for {}: install packaging/udev/72-gnathion-depth.rules", id));
    if (last_error != 0) return bad_input(kWhat, where, fmt::format("{}: {}", id, text_of(last_error)));
    return bad_input(kWhat, where,
                     fmt::format("no camera {}{} is plugged in", id,
                                 choice.serial.empty() ? "" : " with serial " + choice.serial));
  }

  Status claim(const std::string& where) {
    libusb_config_descriptor* config = nullptr;
    if (const int error = libusb_get_active_config_descriptor(libusb_get_device(handle), &config); error != 0)
      return bad_input(kWhat, where, "configuration: " + text_of(error));
    auto found = depth_interface(*config, where);
    libusb_free_config_descriptor(config);
    if (!found) return tl::unexpected<Error>(found.error());
    depth = std::move(*found);
    if (depth.endpoint == 0)
      return bad_input(kWhat, where,
                       depth.isochronous
                           ? "its depth comes over an isochronous endpoint; only bulk endpoints are supported"
                           : "its depth interface has no bulk endpoint");
    if (libusb_kernel_driver_active(handle, depth.number) == 1)
      driver_aside = libusb_detach_kernel_driver(handle, depth.number) == 0;
    if (const int error = libusb_claim_interface(handle, depth.number); error != 0)
      return bad_input(kWhat, where,
                       fmt::format("interface {}: {}; is another program using the camera?", depth.number,
                                   text_of(error)));
    interface = depth.number;
    return {};
  }

  Result<std::string> control(std::uint8_t request, std::uint16_t what, std::string bytes,
                              const std::string& where) const {
    const bool in = (request & 0x80) != 0;
    const int n = libusb_control_transfer(
        handle,
        static_cast<std::uint8_t>((in ? 0x80 : 0x00) | LIBUSB_REQUEST_TYPE_CLASS |
                                  LIBUSB_RECIPIENT_INTERFACE),
        request, what, static_cast<std::uint16_t>(interface), reinterpret_cast<unsigned char*>(bytes.data()),
        static_cast<std::uint16_t>(bytes.size()), kControlTimeout_ms);
    if (n < 0)
      return bad_input(kWhat, where,
                       fmt::format("{} of {}: {}", in ? "reading" : "setting",
                                   what == kProbe ? "probe" : "commit", text_of(n)));
    bytes.resize(static_cast<std::size_t>(n));
    return bytes;
  }
};

UvcDepthStream::UvcDepthStream() : usb_(std::make_unique<Usb>()) {}
UvcDepthStream::~UvcDepthStream() = default;

Result<std::unique_ptr<UvcDepthStream>> UvcDepthStream::open(const UvcDepthChoice& choice,
                                                             const std::string& where) {
  std::unique_ptr<UvcDepthStream> stream(new UvcDepthStream);
  Usb& usb = *stream->usb_;
  GNATHION_CHECK_OK(usb.find(choice, where));
  GNATHION_CHECK_OK(usb.claim(where));
  libusb_device_descriptor d{};
  libusb_get_device_descriptor(libusb_get_device(usb.handle), &d);
  stream->model_ = usb.string_of(d.iProduct);
  stream->serial_ = usb.string_of(d.iSerialNumber);
  stream->where_ = where;

  const std::vector<DepthMode>& modes = usb.depth.modes.modes;
  const auto mode = std::find_if(modes.begin(), modes.end(), [&](const DepthMode& m) {
    return m.width_px == choice.width_px && m.height_px == choice.height_px;
  });
  if (mode == modes.end()) {
    std::vector<std::string> sizes;
    for (const DepthMode& m : modes) sizes.push_back(fmt::format("{}x{}", m.width_px, m.height_px));
    return bad_input(kWhat, where,
                     fmt::format("no depth of {}x{} pixels as in the intrinsics; it offers {}",
                                 choice.width_px, choice.height_px, fmt::join(sizes, ", ")));
  }
  stream->mode_ = *mode;
  const std::size_t frame_bytes =
      2 * static_cast<std::size_t>(mode->width_px) * static_cast<std::size_t>(mode->height_px);
  StreamControl wish;
  wish.format = mode->format;
  wish.frame = mode->frame;
  wish.interval_100ns = mode->interval_100ns;
  GNATHION_CHECK_OK(usb.control(kSetCur, kProbe, format_stream_control(wish), where));
  GNATHION_TRY(const std::string answer, usb.control(kGetCur, kProbe, std::string(26, '\0'), where));
  const auto offered = parse_stream_control(answer);
  if (!offered || offered->format != wish.format || offered->frame != wish.frame)
    return bad_input(kWhat, where, "the camera does not agree to its own depth mode");
  GNATHION_CHECK_OK(usb.control(kSetCur, kCommit, answer, where));
  stream->assembler_ = std::make_unique<PayloadAssembler>(frame_bytes);
  // A payload is one transfer; a camera that names no size, or an absurd one, gets room for a whole frame.
  const std::size_t wanted = offered->payload_bytes;
  const std::size_t room = wanted >= 64 && wanted <= frame_bytes + 256 ? wanted : frame_bytes + 256;
  stream->buffer_.resize((room + 1023) / 1024 * 1024);
  return stream;
}

Result<UvcDepthStream::Event> UvcDepthStream::next(int timeout_ms) {
  Event event;
  int n = 0;
  const int error = libusb_bulk_transfer(
      usb_->handle, usb_->depth.endpoint, reinterpret_cast<unsigned char*>(buffer_.data()),
      static_cast<int>(buffer_.size()), &n, static_cast<unsigned>(timeout_ms));
  if (error == LIBUSB_ERROR_PIPE) {
    libusb_clear_halt(usb_->handle, usb_->depth.endpoint);
    event.lost = "stall";
    return event;
  }
  if (error == LIBUSB_ERROR_OVERFLOW) {
    event.lost = "babble: more than the announced payload";
    return event;
  }
  if (error != 0 && error != LIBUSB_ERROR_TIMEOUT)
    return fail(ErrorCode::kInput, "depth camera lost", where_, text_of(error));
  if (n == 0) return event;
  PayloadAssembler::Outcome outcome = assembler_->add({buffer_.data(), static_cast<std::size_t>(n)});
  event.lost = std::move(outcome.lost);
  if (outcome.frame) {
    GNATHION_TRY(event.frame, decode_z16(*outcome.frame, mode_.width_px, mode_.height_px));
  }
  return event;
}

}  // namespace gnathion
