#include "acquisition/exchange/export_recording.h"

#include <fmt/format.h>

#include <map>
#include <opencv2/imgcodecs.hpp>

#include "acquisition/exchange/csv_tables.h"
#include "acquisition/exchange/plus_collector.h"
#include "acquisition/exchange/pose_source.h"
#include "core/file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot export recording";

/// PNG files numbered in order, one folder a camera.
class ImageFolders {
 public:
  explicit ImageFolders(fs::path folder) : folder_(std::move(folder)) {}
  /// The file's name within its camera's folder.
  Result<std::string> write(const FrameSample& frame) {
    const fs::path folder = folder_ / file_stem(frame.header.stream);
    std::uint64_t& count = counts_[frame.header.stream];
    std::error_code ec;
    if (count == 0) fs::create_directories(folder, ec);
    const std::string name = fmt::format("{:06}.png", count++);
    const cv::Mat picture(frame.image.height_px, frame.image.width_px, CV_8UC1,
                          const_cast<std::uint8_t*>(frame.image.pixels.data()));
    try {
      if (cv::imwrite((folder / name).string(), picture, {cv::IMWRITE_PNG_COMPRESSION, 1})) return name;
    } catch (const cv::Exception& e) {
      return fail(ErrorCode::kInternal, kWhat, (folder / name).string(), e.what());
    }
    return fail(ErrorCode::kInternal, kWhat, (folder / name).string(),
                "cannot be written; is the disk full?");
  }
  std::vector<std::string> folders() const {
    std::vector<std::string> out;
    for (const auto& [stream, n] : counts_) out.push_back(file_stem(stream) + "/");
    return out;
  }

 private:
  fs::path folder_;
  std::map<std::string, std::uint64_t> counts_;
};

Status write_scan(const fs::path& folder, const ScanSample& scan) {
  const fs::path place = folder / file_stem(scan.header.stream) / fs::path(scan.name).stem();
  std::error_code ec;
  fs::create_directories(place, ec);
  for (const auto& [name, bytes] : scan.files) {
    const fs::path file = fs::path(name).filename();  // never out of the folder
    if (file.empty() || file == "." || file == "..")
      return bad_input(kWhat, scan.header.stream, fmt::format("'{}' is no file name", name));
    GNATHION_CHECK_OK(write_file(place / file, bytes));
  }
  return {};
}

/// Goes through the recording once more for the images of one camera, in step with the sequence's frames.
Status write_sequence(const fs::path& recording, const PlusCollector& collector, const ExportOptions& options,
                      const fs::path& folder) {
  const PlusSequence sequence = collector.sequence();
  if (sequence.frames.empty())
    return bad_input(kWhat, recording.string(),
                     "holds no poses and no images that were asked for: no sequence");
  // Recorded order is by arrival, a sequence's by capture: images that are ahead wait here.
  std::multimap<std::int64_t, Image8> waiting;
  std::unique_ptr<Source> source;
  if (collector.has_images()) {
    GNATHION_TRY(source, open_any_recording(recording));
  }
  auto frame = collector.frames().begin();
  const auto image_of = [&](std::size_t) -> Result<std::optional<Image8>> {
    const auto& [instant, about] = *frame++;
    const std::int64_t ns = instant.first;
    if (!about.has_image) return std::optional<Image8>();
    while (!waiting.count(ns)) {
      GNATHION_TRY(auto sample, source->next());
      if (!sample) return bad_input(kWhat, recording.string(), "has changed while it was read");
      auto* image = std::get_if<FrameSample>(&*sample);
      if (image && image->header.stream == options.plus_images)
        waiting.emplace(image->header.capture.ns, std::move(image->image));
    }
    return std::optional<Image8>(std::move(waiting.extract(waiting.lower_bound(ns)).mapped()));
  };
  return write_plus_sequence(folder / options.plus, sequence, image_of, {options.plus_compressed});
}

}  // namespace

Result<ExportSummary> export_recording(const fs::path& recording, const ExportOptions& options,
                                       const fs::path& out, Progress& progress) {
  progress.begin_step("exporting", 1.0);
  GNATHION_TRY(const auto source, open_any_recording(recording));
  ExportSummary summary;
  CsvTables tables(out);
  ImageFolders folders(out);
  PlusCollector collector(options.plus_images);
  while (true) {
    GNATHION_TRY(const auto sample, source->next());
    if (!sample) break;
    ++summary.samples;
    if (options.csv) GNATHION_CHECK_OK(tables.write(*sample));
    if (!options.plus.empty()) collector.take(*sample);
    if (!options.images) continue;
    if (const auto* frame = std::get_if<FrameSample>(&*sample)) {
      GNATHION_TRY(const std::string file, folders.write(*frame));
      GNATHION_CHECK_OK(tables.write_frame(*frame, file));
    } else if (const auto* scan = std::get_if<ScanSample>(&*sample)) {
      GNATHION_CHECK_OK(write_scan(out, *scan));
    }
  }
  GNATHION_TRY(summary.files, tables.finish());
  for (const std::string& folder : folders.folders()) summary.files.push_back(folder);
  if (!options.plus.empty()) {
    if (!options.plus_images.empty() && !collector.has_images())
      return bad_input(kWhat, recording.string(), fmt::format("has no images of '{}'", options.plus_images));
    GNATHION_CHECK_OK(write_sequence(recording, collector, options, out));
    summary.files.push_back(options.plus);
  }
  return summary;
}

}  // namespace gnathion
