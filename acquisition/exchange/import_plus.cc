#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "acquisition/exchange/import_recording.h"
#include "acquisition/exchange/plus_names.h"
#include "acquisition/exchange/plus_sequence.h"
#include "acquisition/exchange/staged_file.h"
#include "acquisition/luma.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot import sequence";
/// Recorded trackers round and filter: those of PLUS's own test data deviate by up to 5e-4.
constexpr double kRotationTolerance = 2e-3;
constexpr double kRounding = 1e-13;  ///< of a rotation in doubles: taken bit for bit

Sample pose_from(const std::string& name, const PlusTransform& t, SampleHeader header) {
  const RigidityDeviation deviation = rigidity_deviation(t.matrix);
  const bool rigid = deviation.is_rigid(kRotationTolerance);
  header.stream = name;
  if (t.valid && !rigid)
    return LedgerSample{header, LedgerSample::Fate::kRejected, 1,
                        deviation.finite ? "not a rotation" : "not finite"};
  const PlusNames names = split_transform_name(name);
  return PoseSample{header,
                    names.to,
                    names.from,
                    t.valid,
                    t.valid ? "" : t.status,
                    !rigid                          ? Rigid3::identity()
                    : deviation.is_rigid(kRounding) ? Rigid3::from_matrix(t.matrix)
                                                    : nearest_rigid(t.matrix)};
}

/// Grey from interleaved bytes of 1, 3 or 4 channels.
Image8 image_from(const PlusSequence& s, const std::string& pixels) {
  Image8 image(s.width_px, s.height_px);
  const auto channels = static_cast<std::size_t>(s.channels);
  const auto at = [&](std::size_t i) { return static_cast<std::uint8_t>(pixels[i]); };
  for (std::size_t i = 0; i < image.pixels.size(); ++i) {
    const std::size_t k = i * channels;
    image.pixels[i] = channels == 1 ? at(k) : luma_from_rgb(at(k), at(k + 1), at(k + 2));
  }
  return image;
}

/// Why the sequence's images are not read; empty: they are.
std::string image_fault(const PlusSequence& s) {
  if (s.pixel != PlusPixel::kUint8) return "pixels are not unsigned 8-bit";
  if (s.channels != 1 && s.channels != 3 && s.channels != 4) return fmt::format("{} channels", s.channels);
  return {};
}

struct Importer {
  PlusReader& reader;
  std::string path, image_stream;
  std::optional<double> rate_hz;
  std::int64_t start_ns = 0;
  ImportSummary summary = {};

  Result<SampleHeader> header_of_frame(std::size_t i) const;
  Status write_frame(RecordingWriter& writer, std::size_t i);
  Status put(RecordingWriter& writer, const Sample& sample);
};

/// start + t, where it is a time: not before 0, not beyond what ns can hold.
std::optional<HostTime> time_after(std::int64_t start_ns, std::int64_t t_ns) {
  HostTime time;
  if (__builtin_add_overflow(start_ns, t_ns, &time.ns) || time.ns < 0) return std::nullopt;
  return time;
}

Result<SampleHeader> Importer::header_of_frame(std::size_t i) const {
  const PlusFrame& f = reader.sequence().frames[i];
  const std::string where = fmt::format("{}: frame {}", path, i);
  SampleHeader header;
  header.sequence = f.number.value_or(static_cast<std::uint32_t>(i));
  if (rate_hz) {
    header.capture.ns = std::llround(static_cast<double>(i) * 1e9 / *rate_hz);
    header.arrival = header.capture;
    header.device.ns = header.capture.ns;
    return header;
  }
  if (!f.timestamp_ns) return bad_input(kWhat, where, "has no Timestamp; give --rate-hz");
  const auto capture = time_after(start_ns, *f.timestamp_ns);
  const auto arrival = time_after(start_ns, f.unfiltered_timestamp_ns.value_or(*f.timestamp_ns));
  if (!capture || !arrival) return bad_input(kWhat, where, "is before time 0, or after the year 2262");
  header.capture = *capture;
  header.arrival = *arrival;
  header.device.ns = *f.timestamp_ns;
  return header;
}

Status Importer::put(RecordingWriter& writer, const Sample& sample) {
  ++(std::holds_alternative<LedgerSample>(sample)  ? summary.rejected
     : std::holds_alternative<FrameSample>(sample) ? summary.frames
                                                   : summary.poses);
  return writer.write(sample);
}

Status Importer::write_frame(RecordingWriter& writer, std::size_t i) {
  const PlusSequence& s = reader.sequence();
  const PlusFrame& f = s.frames[i];
  GNATHION_TRY(SampleHeader header, header_of_frame(i));
  for (const auto& [name, transform] : f.transforms)
    if (transform.status != kPlusNotMeasured)
      GNATHION_CHECK_OK(put(writer, pose_from(name, transform, header)));
  if (s.width_px == 0) return {};
  header.stream = image_stream;
  const std::string fault = image_fault(s);
  if (!fault.empty()) {
    if (!f.has_image) return {};
    return put(writer, LedgerSample{header, LedgerSample::Fate::kRejected, 1, fault});
  }
  GNATHION_TRY(const std::string pixels, reader.next_pixels());
  if (!f.has_image) return {};
  return put(writer, FrameSample{header, image_from(s, pixels)});
}

}  // namespace

Result<ImportSummary> import_plus_sequence(const std::filesystem::path& path, const std::string& image_stream,
                                           std::optional<double> rate_hz, const std::filesystem::path& out,
                                           Progress& progress) {
  if (rate_hz && !(*rate_hz >= 1e-3 && *rate_hz <= 1e5))
    return fail(ErrorCode::kUsage, kWhat, path.string(),
                fmt::format("{} Hz is no frame rate (0.001 to 100000)", *rate_hz));
  GNATHION_TRY(PlusReader reader, PlusReader::open(path));
  const PlusSequence& s = reader.sequence();
  Importer importer{reader, path.string(), image_stream, rate_hz};
  if (const auto start = s.fields.find(kPlusStartField); start != s.fields.end())
    importer.start_ns = ns_from_decimal(start->second).value_or(0);
  progress.begin_step("importing the sequence", 1.0);
  const Status status = write_whole_recording(out, [&](RecordingWriter& writer) -> Status {
    for (std::size_t i = 0; i < s.frames.size(); ++i) {
      GNATHION_CHECK_OK(importer.write_frame(writer, i));
      progress.update(static_cast<double>(i + 1) / static_cast<double>(s.frames.size()));
    }
    if (importer.summary.poses + importer.summary.frames == 0)
      return bad_input(kWhat, path.string(),
                       importer.summary.rejected > 0 && !image_fault(s).empty()
                           ? image_fault(s)
                           : "holds neither poses nor 8-bit images");
    const nlohmann::json origin = {{"origin", "plus sequence"}, {"fields", s.fields}};
    return writer.attach("import.json", "application/json",
                         origin.dump(2, ' ', false, nlohmann::json::error_handler_t::replace));
  });
  if (!status) return tl::unexpected<Error>(status.error());
  return std::move(importer.summary);
}

}  // namespace gnathion
