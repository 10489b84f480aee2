#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "acquisition/exchange/import_recording.h"
#include "acquisition/exchange/picture_reader.h"
#include "acquisition/exchange/staged_file.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot import images";

struct Camera {
  std::string stream;
  std::unique_ptr<PictureReader> reader;
  std::optional<Picture> ahead = {};  ///< the next; nothing: over
  std::size_t frames = 0;
  std::uint32_t end = 0;  ///< one beyond the last number
};

/// The rate of all streams: the one asked for, or the videos' own where they agree.
Result<double> rate_of(const std::vector<Camera>& cameras, std::optional<double> asked_hz,
                       ImportSummary& summary) {
  std::optional<double> own_hz;
  for (const Camera& c : cameras) {
    const auto rate_hz = c.reader->own_rate_hz();
    if (!rate_hz) continue;
    if (asked_hz && std::abs(*rate_hz - *asked_hz) > 1e-3 * *asked_hz)
      summary.notes.push_back(fmt::format("{}: the video says {:.6g} Hz; {:.6g} Hz was asked for and taken",
                                          c.stream, *rate_hz, *asked_hz));
    if (!asked_hz && own_hz && std::abs(*own_hz - *rate_hz) > 1e-3 * *own_hz)
      return bad_input(
          kWhat, c.stream,
          fmt::format("the videos' rates differ ({:.6g} and {:.6g} Hz); give --rate-hz", *own_hz, *rate_hz));
    own_hz = rate_hz;
  }
  const std::optional<double> rate_hz = asked_hz ? asked_hz : own_hz;
  if (!rate_hz)
    return fail(ErrorCode::kUsage, kWhat, cameras.front().stream, "pictures have no rate; give --rate-hz");
  if (!(*rate_hz >= 1e-3 && *rate_hz <= 1e5))
    return fail(ErrorCode::kUsage, kWhat, cameras.front().stream,
                fmt::format("{} Hz is no frame rate (0.001 to 100000)", *rate_hz));
  if (!asked_hz) summary.notes.push_back(fmt::format("the video's own rate was taken: {:.6g} Hz", *rate_hz));
  return *rate_hz;
}

HostTime time_of(std::uint32_t number, double rate_hz) {
  return {std::llround(static_cast<double>(number) * 1e9 / rate_hz)};
}

/// Picture i of every camera, at one instant, until all are over. The writer tells of numbers left out.
Status write_frames(RecordingWriter& writer, std::vector<Camera>& cameras, double rate_hz,
                    Progress& progress) {
  std::size_t expected = 1;
  for (Camera& c : cameras) {
    expected = std::max(expected, c.reader->expected());
    GNATHION_TRY(c.ahead, c.reader->next());
  }
  for (std::uint32_t i = 0;; ++i) {
    const HostTime time = time_of(i, rate_hz);
    bool any = false;
    for (Camera& c : cameras) {
      if (!c.ahead) continue;
      any = true;
      if (c.ahead->number != i) continue;
      ++c.frames;
      c.end = i + 1;
      GNATHION_CHECK_OK(
          writer.write(FrameSample{{c.stream, i, time, time, {time.ns}}, std::move(c.ahead->image)}));
      GNATHION_TRY(c.ahead, c.reader->next());
    }
    if (!any) return {};
    progress.update(std::min(1.0, static_cast<double>(i) / static_cast<double>(expected)));
  }
}

/// What a camera should have had behind its last picture: frames that a video announces and the decoder does
/// not give. It does not say where they were; they stand at the end.
Status write_shortfall(RecordingWriter& writer, const Camera& c, double rate_hz) {
  if (c.reader->expected() <= c.end) return {};
  const HostTime time = time_of(c.end, rate_hz);
  return writer.write(LedgerSample{{c.stream, c.end, time, time, {time.ns}},
                                   LedgerSample::Fate::kMissing,
                                   static_cast<std::uint32_t>(c.reader->expected() - c.end),
                                   "announced, not decoded"});
}

void note_what_differs(const std::vector<Camera>& cameras, ImportSummary& summary) {
  for (const Camera& c : cameras) {
    summary.frames += c.frames;
    for (const std::string& note : c.reader->notes()) summary.notes.push_back(c.stream + ": " + note);
    if (c.frames != cameras.front().frames)
      summary.notes.push_back(fmt::format("{}: {} pictures, {} has {}", c.stream, c.frames,
                                          cameras.front().stream, cameras.front().frames));
  }
}

std::string origin_of(const std::vector<Camera>& cameras, double rate_hz,
                      const std::vector<std::string>& notes) {
  nlohmann::json streams = nlohmann::json::object();
  for (const Camera& c : cameras) streams[c.stream] = {{"frames", c.frames}};
  return nlohmann::json{{"origin", "images"}, {"rate_hz", rate_hz}, {"streams", streams}, {"notes", notes}}
      .dump(2, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

Result<ImportSummary> import_images(const std::vector<ImageImport>& streams, std::optional<double> rate_hz,
                                    const std::filesystem::path& out, Progress& progress) {
  ImportSummary summary;
  std::vector<Camera> cameras;
  for (const ImageImport& s : streams) {
    for (const Camera& c : cameras)
      if (c.stream == s.stream) return fail(ErrorCode::kUsage, kWhat, s.stream, "is named twice");
    GNATHION_TRY(auto reader, PictureReader::open(s.path));
    cameras.push_back({s.stream, std::move(reader)});
  }
  if (cameras.empty()) return fail(ErrorCode::kUsage, kWhat, out.string(), "no images are named");
  GNATHION_TRY(const double rate, rate_of(cameras, rate_hz, summary));
  progress.begin_step("importing images", 1.0);
  const Status status = write_whole_recording(out, [&](RecordingWriter& writer) -> Status {
    GNATHION_CHECK_OK(write_frames(writer, cameras, rate, progress));
    for (const Camera& c : cameras)
      if (c.frames == 0) return bad_input(kWhat, c.stream, "not one picture could be read");
    for (const Camera& c : cameras) GNATHION_CHECK_OK(write_shortfall(writer, c, rate));
    note_what_differs(cameras, summary);
    return writer.attach("import.json", "application/json", origin_of(cameras, rate, summary.notes));
  });
  if (!status) return tl::unexpected<Error>(status.error());
  return summary;
}

}  // namespace gnathion
