#include "acquisition/camera/aravis_camera.h"

#include <arv.h>
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot open camera";

/// An error of GLib, taken over and freed.
class GlibError {
 public:
  GlibError() = default;
  GlibError(const GlibError&) = delete;
  GlibError& operator=(const GlibError&) = delete;
  ~GlibError() { g_clear_error(&error_); }
  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  explicit operator bool() const { return error_ != nullptr; }
  std::string text() const { return error_ ? error_->message : ""; }

 private:
  GError* error_ = nullptr;
};

struct Unref {
  void operator()(gpointer object) const {
    if (object) g_object_unref(object);
  }
};
template <class T>
using Owned = std::unique_ptr<T, Unref>;

std::string text_or_empty(const char* text) {
  return text ? text : "";
}

std::string lower(std::string s) {
  for (char& c : s) c = g_ascii_tolower(c);
  return s;
}

/// A list of names that the camera hands over to be freed (the list, not its texts).
std::vector<std::string> names_of(const char** names, guint count) {
  std::vector<std::string> list;
  for (guint i = 0; names && i < count; ++i) list.emplace_back(names[i]);
  g_free(names);
  return list;
}

std::string why_bad(ArvBufferStatus status) {
  switch (status) {
    case ARV_BUFFER_STATUS_SUCCESS:
      return "";
    case ARV_BUFFER_STATUS_TIMEOUT:
      return "not complete in time";
    case ARV_BUFFER_STATUS_MISSING_PACKETS:
      return "packets missing";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID:
      return "wrong packet id";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH:
      return "larger than announced";
    case ARV_BUFFER_STATUS_ABORTED:
      return "aborted";
    default:
      return fmt::format("buffer status {}", static_cast<int>(status));
  }
}

/// Copies the pixels, or says why not.
std::string copy_image(ArvBuffer* buffer, Image8* image) {
  const ArvBufferPayloadType payload = arv_buffer_get_payload_type(buffer);
  if (payload != ARV_BUFFER_PAYLOAD_TYPE_IMAGE && payload != ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA)
    return "not an image";
  if (arv_buffer_get_image_pixel_format(buffer) != ARV_PIXEL_FORMAT_MONO_8)
    return fmt::format("pixel format 0x{:08x} instead of Mono8", arv_buffer_get_image_pixel_format(buffer));
  gint x_padding = 0, y_padding = 0;
  arv_buffer_get_image_padding(buffer, &x_padding, &y_padding);
  const int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
  size_t size = 0;
  const auto* data = static_cast<const std::uint8_t*>(arv_buffer_get_image_data(buffer, &size));
  const std::size_t step = static_cast<std::size_t>(std::max(0, width) + std::max(0, x_padding));
  if (!data || width <= 0 || height <= 0 || size < step * static_cast<std::size_t>(height))
    return fmt::format("{}x{} px announced, {} bytes came", width, height, size);
  *image = Image8(width, height);
  for (int y = 0; y < height; ++y)
    std::memcpy(&image->at(0, y), data + step * static_cast<std::size_t>(y), static_cast<std::size_t>(width));
  return "";
}

}  // namespace

struct AravisCamera::Handles {
  ~Handles() {
    if (camera && lost_handler)
      g_signal_handler_disconnect(arv_camera_get_device(camera.get()), lost_handler);
    if (camera && streaming && !lost) arv_camera_stop_acquisition(camera.get(), nullptr);
  }
  Owned<ArvCamera> camera;
  Owned<ArvStream> stream;  // goes first: its thread fills buffers of the camera
  gulong lost_handler = 0;
  bool streaming = false;
  std::atomic<bool> lost{false};
};

AravisCamera::AravisCamera() : handles_(std::make_unique<Handles>()) {}
AravisCamera::~AravisCamera() = default;

Result<std::unique_ptr<AravisCamera>> AravisCamera::open(const AravisSettings& settings,
                                                         const std::string& where) {
  std::unique_ptr<AravisCamera> camera(new AravisCamera);
  GNATHION_CHECK_OK(camera->find(settings, where));
  GNATHION_CHECK_OK(camera->set(settings, where));
  GNATHION_CHECK_OK(camera->start(settings, where));
  return camera;
}

Status AravisCamera::find(const AravisSettings& s, const std::string& where) {
  std::string name = !s.ip.empty() ? s.ip : s.id;
  if (name.empty()) {
    arv_update_device_list();
    std::vector<std::string> seen;
    for (unsigned i = 0; i < arv_get_n_devices(); ++i) {
      const std::string its_serial = text_or_empty(arv_get_device_serial_nbr(i));
      seen.push_back(fmt::format("{} {}", text_or_empty(arv_get_device_model(i)), its_serial));
      if (its_serial != s.serial) continue;
      if (!name.empty())
        return bad_input(kWhat, where,
                         fmt::format("two cameras have the serial {}; choose one by ip", s.serial));
      name = text_or_empty(arv_get_device_id(i));
    }
    if (name.empty())
      return bad_input(kWhat, where,
                       fmt::format("no camera with serial {}; {}", s.serial,
                                   seen.empty() ? "none was found: check power and network, or install "
                                                  "packaging/udev/71-gnathion-cameras.rules for USB"
                                                : fmt::format("found: {}", fmt::join(seen, ", "))));
  }
  GlibError error;
  handles_->camera.reset(arv_camera_new(name.c_str(), error.out()));
  ArvCamera* camera = handles_->camera.get();
  if (!camera || error)
    return bad_input(kWhat, where,
                     fmt::format("{}: {}", name, error ? error.text() : "there is no such camera"));
  if (arv_camera_is_gv_device(camera) &&
      !arv_gv_device_is_controller(ARV_GV_DEVICE(arv_camera_get_device(camera))))
    return bad_input(kWhat, where, fmt::format("{} is under the control of another program or device", name));
  vendor = text_or_empty(arv_camera_get_vendor_name(camera, error.out()));
  model = text_or_empty(arv_camera_get_model_name(camera, error.out()));
  serial = text_or_empty(arv_camera_get_device_serial_number(camera, error.out()));
  if (!s.serial.empty() && s.serial != serial)
    return bad_input(kWhat, where,
                     fmt::format("the camera at {} has the serial {}, not {}", name, serial, s.serial));
  handles_->lost_handler = g_signal_connect(
      arv_camera_get_device(camera), "control-lost",
      G_CALLBACK(+[](ArvDevice*, gpointer lost) { *static_cast<std::atomic<bool>*>(lost) = true; }),
      &handles_->lost);
  return {};
}

void AravisCamera::report(const std::string& name, double got, const std::optional<double>& asked) {
  const bool differs = asked && std::abs(got - *asked) > 1e-6 * std::abs(*asked);
  setting_lines.push_back(differs ? fmt::format("{}: {} (asked {})", name, got, *asked)
                                  : fmt::format("{}: {}", name, got));
  if (differs) warning_lines.push_back(setting_lines.back());
}

Status AravisCamera::set(const AravisSettings& s, const std::string& where) {
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  arv_camera_stop_acquisition(camera, error.out());  // it may run since a program before us died
  arv_camera_set_pixel_format(camera, ARV_PIXEL_FORMAT_MONO_8, error.out());
  if (error || arv_camera_get_pixel_format(camera, error.out()) != ARV_PIXEL_FORMAT_MONO_8) {
    guint count = 0;
    const char** formats = arv_camera_dup_available_pixel_formats_as_strings(camera, &count, error.out());
    return bad_input(kWhat, where,
                     fmt::format("pixel format Mono8 is not possible; the camera has {}",
                                 fmt::join(names_of(formats, count), ", ")));
  }
  setting_lines.push_back("pixel_format: Mono8");
  arv_camera_set_acquisition_mode(camera, ARV_ACQUISITION_MODE_CONTINUOUS, error.out());
  GNATHION_CHECK_OK(set_region(s, where));
  turn_automatics_off();
  shorten_exposure(s);
  GNATHION_CHECK_OK(set_trigger(s, where));
  GNATHION_CHECK_OK(set_exposure(s, where));
  return set_gain(s, where);
}

/// Capture times are mid-exposure by the exposure that is read once: it must not change by itself.
void AravisCamera::turn_automatics_off() {
  ArvCamera* camera = handles_->camera.get();
  const auto told = [&](const char* name, bool off) {
    setting_lines.push_back(fmt::format("{}: {}", name, off ? "off" : "on"));
    if (!off) warning_lines.push_back(fmt::format("{}: the camera does not turn it off", name));
  };
  GlibError exposure, gain;
  if (arv_camera_is_exposure_auto_available(camera, exposure.out())) {
    arv_camera_set_exposure_time_auto(camera, ARV_AUTO_OFF, exposure.out());
    const bool off = arv_camera_get_exposure_time_auto(camera, exposure.out()) == ARV_AUTO_OFF;
    told("exposure_auto", off && !exposure);
  }
  if (arv_camera_is_gain_auto_available(camera, gain.out())) {
    arv_camera_set_gain_auto(camera, ARV_AUTO_OFF, gain.out());
    const bool off = arv_camera_get_gain_auto(camera, gain.out()) == ARV_AUTO_OFF;
    told("gain_auto", off && !gain);
  }
}

/// On many cameras rate and exposure bound each other, and the bounds of both are those of whatever was set
/// before. A long exposure left behind must not forbid the rate; a high rate must not forbid the exposure,
/// which is therefore checked after the rate.
void AravisCamera::shorten_exposure(const AravisSettings& s) {
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  if (!s.exposure_us || !arv_camera_is_exposure_time_available(camera, error.out())) return;
  if (*s.exposure_us < arv_camera_get_exposure_time(camera, error.out()))
    arv_camera_set_exposure_time(camera, *s.exposure_us, error.out());  // set_exposure() tells what failed
}

Status AravisCamera::set_region(const AravisSettings& s, const std::string& where) {
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  gint x = 0, y = 0, width = 0, height = 0;
  arv_camera_get_region(camera, &x, &y, &width, &height, error.out());
  if (s.width_px || s.height_px || s.x_px || s.y_px)
    arv_camera_set_region(camera, s.x_px.value_or(x), s.y_px.value_or(y), s.width_px.value_or(width),
                          s.height_px.value_or(height), error.out());
  if (error) return bad_input(kWhat, where, "region: " + error.text());
  arv_camera_get_region(camera, &x, &y, &width, &height, error.out());
  if (error) return bad_input(kWhat, where, "region: " + error.text());
  report("width_px", width, s.width_px);
  report("height_px", height, s.height_px);
  if (s.x_px) report("x_px", x, s.x_px);
  if (s.y_px) report("y_px", y, s.y_px);
  return {};
}

Status AravisCamera::set_exposure(const AravisSettings& s, const std::string& where) {
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  if (!arv_camera_is_exposure_time_available(camera, error.out())) {
    if (s.exposure_us) warning_lines.push_back("exposure_us: the camera has no such setting");
    return {};
  }
  if (s.exposure_us) {
    double low = 0, high = 0;
    arv_camera_get_exposure_time_bounds(camera, &low, &high, error.out());
    if (!error && !(*s.exposure_us >= low && *s.exposure_us <= high))
      return bad_input(
          kWhat, where,
          fmt::format("exposure_us {} is impossible: the camera allows {} to {}", *s.exposure_us, low, high));
    arv_camera_set_exposure_time(camera, *s.exposure_us, error.out());
    if (error) return bad_input(kWhat, where, "exposure_us: " + error.text());
  }
  exposure_us = arv_camera_get_exposure_time(camera, error.out());
  if (error) return bad_input(kWhat, where, "exposure_us: " + error.text());
  report("exposure_us", exposure_us, s.exposure_us);
  return {};
}

Status AravisCamera::set_gain(const AravisSettings& s, const std::string& where) {
  if (!s.gain) return {};
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  if (!arv_camera_is_gain_available(camera, error.out())) {
    warning_lines.push_back("gain: the camera has no such setting");
    return {};
  }
  double low = 0, high = 0;
  arv_camera_get_gain_bounds(camera, &low, &high, error.out());
  if (!error && !(*s.gain >= low && *s.gain <= high))
    return bad_input(kWhat, where,
                     fmt::format("gain {} is impossible: the camera allows {} to {}", *s.gain, low, high));
  arv_camera_set_gain(camera, *s.gain, error.out());
  const double got = error ? 0 : arv_camera_get_gain(camera, error.out());
  if (error) return bad_input(kWhat, where, "gain: " + error.text());
  report("gain", got, s.gain);
  return {};
}

/// Free running at a rate, or one frame for each edge on a line.
Status AravisCamera::set_trigger(const AravisSettings& s, const std::string& where) {
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  if (s.trigger != "free") {
    guint count = 0;
    const char** list = arv_camera_dup_available_trigger_sources(camera, &count, error.out());
    const std::vector<std::string> sources = names_of(list, count);
    const auto found = std::find_if(sources.begin(), sources.end(),
                                    [&](const std::string& x) { return lower(x) == lower(s.trigger); });
    if (found == sources.end())
      return bad_input(
          kWhat, where,
          fmt::format("trigger '{}' is not one of the camera's: {}", s.trigger, fmt::join(sources, ", ")));
    arv_camera_set_trigger(camera, found->c_str(), error.out());
    if (error) return bad_input(kWhat, where, "trigger: " + error.text());
    setting_lines.push_back("trigger: " + *found);
    return {};
  }
  arv_camera_clear_triggers(camera, error.out());
  setting_lines.push_back("trigger: free running");
  const bool settable = arv_camera_is_frame_rate_available(camera, error.out());
  if (s.rate_hz && !settable)
    return bad_input(kWhat, where, "rate_hz cannot be set: the camera has no frame rate");
  if (s.rate_hz) {
    double low = 0, high = 0;
    arv_camera_get_frame_rate_bounds(camera, &low, &high, error.out());
    if (!error && !(*s.rate_hz >= low && *s.rate_hz <= high))
      return bad_input(kWhat, where,
                       fmt::format("rate_hz {} is impossible: the camera allows {} to {} with these settings",
                                   *s.rate_hz, low, high));
    arv_camera_set_frame_rate(camera, *s.rate_hz, error.out());
    if (error) return bad_input(kWhat, where, "rate_hz: " + error.text());
  }
  if (settable) rate_hz = arv_camera_get_frame_rate(camera, error.out());
  if (error) return bad_input(kWhat, where, "rate_hz: " + error.text());
  if (settable) report("rate_hz", rate_hz, s.rate_hz);
  return {};
}

Status AravisCamera::start(const AravisSettings& s, const std::string& where) {
  ArvCamera* camera = handles_->camera.get();
  GlibError error;
  if (arv_camera_is_gv_device(camera) && s.packet_size_bytes) {
    arv_camera_gv_set_packet_size(camera, *s.packet_size_bytes, error.out());
    if (error) return bad_input(kWhat, where, "packet_size_bytes: " + error.text());
  }
  handles_->stream.reset(arv_camera_create_stream(camera, nullptr, nullptr, error.out()));
  if (!handles_->stream || error) return bad_input(kWhat, where, "no stream: " + error.text());
  const guint payload = arv_camera_get_payload(camera, error.out());
  if (error || payload == 0) return bad_input(kWhat, where, "no payload size: " + error.text());
  for (int i = 0; i < s.buffers; ++i)
    arv_stream_push_buffer(handles_->stream.get(), arv_buffer_new(payload, nullptr));
  if (arv_camera_is_gv_device(camera))
    setting_lines.push_back(
        fmt::format("packet_size_bytes: {}", arv_camera_gv_get_packet_size(camera, error.out())));
  arv_camera_start_acquisition(camera, error.out());
  if (error) return bad_input(kWhat, where, "does not start: " + error.text());
  handles_->streaming = true;
  return {};
}

std::optional<AravisCamera::Buffer> AravisCamera::next(int timeout_ms, Clock& clock, HostTime* arrival) {
  ArvBuffer* raw =
      arv_stream_timeout_pop_buffer(handles_->stream.get(), static_cast<guint64>(timeout_ms) * 1000);
  if (!raw) return std::nullopt;
  *arrival = clock.now();
  Buffer buffer;
  buffer.frame_id = arv_buffer_get_frame_id(raw);
  if (const guint64 stamp_ns = arv_buffer_get_timestamp(raw); stamp_ns > 0)
    buffer.device = DeviceTime{static_cast<std::int64_t>(stamp_ns)};
  buffer.bad = why_bad(arv_buffer_get_status(raw));
  if (buffer.bad.empty()) buffer.bad = copy_image(raw, &buffer.image);
  arv_stream_push_buffer(handles_->stream.get(), raw);
  return buffer;
}

bool AravisCamera::control_lost() const {
  return handles_->lost;
}

bool AravisCamera::answers() {
  GlibError error;
  arv_camera_get_payload(handles_->camera.get(), error.out());
  return !error;
}

}  // namespace gnathion
