#include "pipeline/phantom_device.h"

#include <fmt/format.h>

#include "acquisition/replay_device.h"
#include "phantom/film.h"
#include "phantom/film_scene.h"
#include "phantom/patient.h"

namespace gnathion {
namespace {

/// The film's time begins at 0; here it begins when the first sample is pulled.
class FromNowOn : public Source {
 public:
  FromNowOn(std::unique_ptr<Source> source, Clock& clock) : source_(std::move(source)), clock_(clock) {}
  Result<std::optional<Sample>> next() override {
    GNATHION_TRY(std::optional<Sample> sample, source_->next());
    if (!sample) return sample;
    std::visit(
        [&](auto& s) {
          if (!shift_ns_) shift_ns_ = clock_.now().ns - s.header.arrival.ns;
          s.header.capture.ns += *shift_ns_;
          s.header.arrival.ns += *shift_ns_;
        },
        *sample);
    return sample;
  }

 private:
  std::unique_ptr<Source> source_;
  Clock& clock_;
  std::optional<std::int64_t> shift_ns_;
};

}  // namespace

Result<std::unique_ptr<Device>> open_phantom_device(const DeviceConfig& config, Clock& clock) {
  SettingsReader reader(config);
  FilmOptions film;
  film.seed = static_cast<std::uint64_t>(reader.integer("seed").value_or(1));
  film.duration_s = reader.number_in("duration_s", 0.1, 3600, 16);
  film.rate_hz = reader.number_in("rate_hz", 1, 1000, 60);
  film.drop_fraction = reader.number_in("drop_fraction", 0, 0.9, 0);
  film.border_movements = reader.flag("border_movements").value_or(true);
  const double speed = reader.number_in("speed", 0, 1000, 1);
  GNATHION_CHECK_OK(reader.finish());
  auto source = std::make_unique<FromNowOn>(
      std::make_unique<PhantomFilm>(film_scene(make_phantom_patient(film.seed)), film), clock);
  DeviceDescription description;
  description.kind = config.kind;
  description.stream = config.stream;
  description.vendor = "Gnathion";
  description.model = "virtual patient";
  description.serial = fmt::format("seed {}", film.seed);
  description.settings = {
      fmt::format("duration_s: {}", film.duration_s), fmt::format("rate_hz: {}", film.rate_hz),
      fmt::format("drop_fraction: {}", film.drop_fraction), fmt::format("speed: {}", speed)};
  return std::unique_ptr<Device>(
      std::make_unique<ReplayDevice>(std::move(source), std::move(description), clock, speed));
}

void add_phantom_device() {
  add_device_kind("phantom", open_phantom_device);
}

}  // namespace gnathion
