// recording import, recording export.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "acquisition/exchange/export_recording.h"
#include "acquisition/exchange/import_recording.h"
#include "cli/command.h"
#include "core/file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

std::string dumped(const json& j) {
  return j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace);
}

bool is_stream_name(const std::string& name) {
  return !name.empty() && std::all_of(name.begin(), name.end(), [](unsigned char c) {
    return std::isalnum(c) || c == '_' || c == '-';
  });
}

bool is_sequence(const std::string& path) {
  for (const char* end : {".mha", ".mhd", ".nrrd", ".nhdr"})
    if (fs::path(path).extension() == end) return true;
  return false;
}

struct ImportOptions {
  std::vector<std::string> images;
  std::string plus, stream, out;
  double rate_hz = 0;
};

/// "NAME=PATH", or a path; the streams without a name are camera_0, camera_1, …
Result<std::vector<ImageImport>> cameras_from(const ImportOptions& o) {
  std::vector<ImageImport> cameras;
  for (const std::string& text : o.images) {
    const std::size_t equals = text.find('=');
    const bool named =
        equals != std::string::npos && !fs::exists(text) && is_stream_name(text.substr(0, equals));
    ImageImport camera;
    camera.path = named ? text.substr(equals + 1) : text;
    camera.stream = named                                       ? text.substr(0, equals)
                    : o.images.size() == 1 && !o.stream.empty() ? o.stream
                                                                : fmt::format("camera_{}", cameras.size());
    cameras.push_back(std::move(camera));
  }
  return cameras;
}

Result<CommandOutput> run_import(ImportOptions o, const CommonOptions& common, Progress& progress) {
  constexpr const char* what = "cannot import";
  if (o.plus.empty() && o.images.size() == 1 && is_sequence(o.images.front())) o.plus.swap(o.images.front());
  if (!o.plus.empty() && !o.images.empty() && !o.images.front().empty())
    return fail(ErrorCode::kUsage, what, o.plus, "images and a sequence at once; import one of them");
  if (o.plus.empty() && o.images.empty())
    return fail(ErrorCode::kUsage, what, o.out, "--images or --plus must name what to import");
  if (!o.stream.empty() && !is_stream_name(o.stream))
    return fail(ErrorCode::kUsage, what, o.stream, "is no stream name: letters, digits, '_' and '-'");
  std::optional<double> rate_hz;
  if (o.rate_hz != 0) rate_hz = o.rate_hz;
  GNATHION_TRY(const std::vector<ImageImport> cameras, cameras_from(o));
  std::vector<std::string> inputs = {o.plus};
  for (const ImageImport& c : cameras) inputs.push_back(c.path.string());
  GNATHION_CHECK_OK(may_write(o.out, common, inputs));
  GNATHION_TRY(const ImportSummary summary,
               o.plus.empty() ? import_images(cameras, rate_hz, o.out, progress)
                              : import_plus_sequence(o.plus, o.stream.empty() ? "image" : o.stream, rate_hz,
                                                     o.out, progress));
  std::string text = fmt::format("{} frames, {} poses, {} rejected in {}\n", summary.frames, summary.poses,
                                 summary.rejected, o.out);
  for (const std::string& note : summary.notes) text += note + "\n";
  return CommandOutput{text,
                       dumped({{"frames", summary.frames},
                               {"poses", summary.poses},
                               {"rejected", summary.rejected},
                               {"notes", summary.notes},
                               {"out", o.out}}),
                       false};
}

void add_import(CLI::App& recording, ChosenCommand& chosen) {
  auto o = std::make_shared<ImportOptions>();
  CLI::App* command = recording.add_subcommand("import", "make a recording of what others filmed or tracked");
  command->add_option("--images", o->images,
                      "folder of images or a video, as [NAME=]PATH; once for each camera");
  command->add_option("--plus", o->plus, "PLUS sequence (.igs.mha, .igs.nrrd, .mhd)");
  command
      ->add_option("--rate-hz", o->rate_hz, "frames a second; a video's or a sequence's own times otherwise")
      ->check(CLI::Range(1e-3, 1e5));
  command->add_option("--stream", o->stream, "name of the images' stream (camera_0; of a sequence: image)");
  command->add_option("--out", o->out, "recording (.mcap)")->required();
  finish_command(*command, chosen, [o](const CommonOptions& common, Progress& progress) {
    return run_import(*o, common, progress);
  });
}

void add_export(CLI::App& recording, ChosenCommand& chosen) {
  struct Options {
    std::string file, out;
    ExportOptions what;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command = recording.add_subcommand(
      "export", "write a recording, or motion.mcap, as tables, images, PLUS sequences");
  command->add_option("FILE", o->file, "recording (.mcap)")->required();
  command->add_option("--out", o->out, "folder")->required();
  command->add_flag("--csv", o->what.csv, "poses, events, ledger: one table a stream");
  command->add_flag("--images", o->what.images, "a folder of PNG files a camera, and the scans' files");
  command->add_option("--plus", o->what.plus, "name of a sequence: F.igs.mha or F.igs.nrrd");
  command->add_option("--plus-images", o->what.plus_images, "the camera whose images go into the sequence");
  command->add_flag("--plus-compressed", o->what.plus_compressed, "compress the sequence's images");
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        ExportOptions what = o->what;
        if (!what.csv && !what.images && what.plus.empty()) what.csv = true;
        if (!what.plus.empty() && (fs::path(what.plus).has_parent_path() || !is_sequence(what.plus)))
          return fail(ErrorCode::kUsage, "cannot export", what.plus,
                      "must be a file name that ends in .igs.mha or .igs.nrrd");
        GNATHION_CHECK_OK(keeps_inputs(o->out, {o->file}));
        GNATHION_TRY(StagedDirectory staged, StagedDirectory::create(o->out, common.force, {"export.json"}));
        GNATHION_TRY(const ExportSummary summary, export_recording(o->file, what, staged.path(), progress));
        const json j = {{"samples", summary.samples}, {"files", summary.files}, {"out", o->out}};
        const json kept = {{"recording", fs::path(o->file).filename().string()},
                           {"samples", summary.samples},
                           {"files", summary.files}};
        GNATHION_CHECK_OK(write_file(staged.path() / "export.json", dumped(kept) + "\n"));
        GNATHION_CHECK_OK(staged.commit());
        std::string text = fmt::format("{} samples in {}\n", summary.samples, o->out);
        for (const std::string& file : summary.files) text += "  " + file + "\n";
        return CommandOutput{text, dumped(j), false};
      });
}

}  // namespace

void add_exchange_commands(CLI::App& recording, ChosenCommand& chosen) {
  add_import(recording, chosen);
  add_export(recording, chosen);
}

}  // namespace gnathion
