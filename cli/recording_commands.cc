// recording info|verify|recover|capture.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "acquisition/recording.h"
#include "cli/capture_command.h"
#include "cli/command.h"

namespace gnathion {
namespace {

using nlohmann::json;

json summary_json(const RecordingSummary& s) {
  json streams = json::object();
  for (const auto& [name, x] : s.streams)
    streams[name] = {
        {"kind", x.kind},         {"received", x.received},   {"missing", x.missing},
        {"rejected", x.rejected}, {"first_s", x.first_s},     {"last_s", x.last_s},
        {"rate_hz", x.rate_hz},   {"jitter_ms", x.jitter_ms}, {"longest_gap_s", x.longest_gap_s}};
  json attachments = json::array();
  for (const AttachmentInfo& a : s.attachments)
    attachments.push_back({{"name", a.name}, {"media_type", a.media_type}, {"bytes", a.bytes}});
  json j = {{"whole", s.whole},
            {"bytes", s.bytes},
            {"duration_s", s.duration_s},
            {"messages", s.messages},
            {"chunks", s.chunks},
            {"longest_chunk_s", s.longest_chunk_s},
            {"largest_chunk_bytes", s.largest_chunk_bytes},
            {"attachments", attachments},
            {"streams", streams}};
  if (!s.whole) j["damage"] = {{"begin", s.damage_begin}, {"end", s.damage_end}, {"why", s.damage}};
  return j;
}

std::string summary_text(const RecordingSummary& s) {
  std::string text = fmt::format("{:.2f} s, {:.1f} MiB, {}\n", s.duration_s,
                                 static_cast<double>(s.bytes) / 1048576.0, s.whole ? "whole" : "damaged");
  text += fmt::format("{:<18} {:<9} {:>9} {:>8} {:>9} {:>9} {:>10} {:>13}\n", "stream", "kind", "received",
                      "missing", "rejected", "rate_hz", "jitter_ms", "longest_gap_s");
  for (const auto& [name, x] : s.streams) {
    std::uint64_t rejected = 0;
    for (const auto& [reason, n] : x.rejected) rejected += n;
    text += fmt::format("{:<18} {:<9} {:>9} {:>8} {:>9} {:>9.2f} {:>10.3f} {:>13.3f}\n", name, x.kind,
                        x.received, x.missing, rejected, x.rate_hz, x.jitter_ms, x.longest_gap_s);
    for (const auto& [reason, n] : x.rejected) text += fmt::format("    rejected: {} × {}\n", n, reason);
  }
  for (const AttachmentInfo& a : s.attachments)
    text += fmt::format("attached: {} ({} bytes)\n", a.name, a.bytes);
  if (!s.whole)
    text += fmt::format("damaged from byte {} to {}: {}\n", s.damage_begin, s.damage_end, s.damage);
  return text;
}

void add_recording_info(CLI::App& recording, ChosenCommand& chosen) {
  auto file = std::make_shared<std::string>();
  for (const bool verify : {false, true}) {
    CLI::App* command = recording.add_subcommand(
        verify ? "verify" : "info",
        verify ? "check every byte of a recording; exit 4 names the first damaged range"
               : "what a recording holds: the ledger, stream by stream");
    command->add_option("FILE", *file, "recording (.mcap)")->required();
    finish_command(
        *command, chosen,
        [file, verify](const CommonOptions&, Progress& progress) -> Result<CommandOutput> {
          progress.begin_step("reading the recording", 1.0);
          GNATHION_TRY(const RecordingSummary s, summarise_recording(*file));
          if (verify && !s.whole)
            return bad_input("recording is damaged", *file,
                             fmt::format("bytes {} to {}: {}", s.damage_begin, s.damage_end, s.damage));
          return CommandOutput{summary_text(s),
                               summary_json(s).dump(2, ' ', false, nlohmann::json::error_handler_t::replace),
                               false};
        },
        false);
  }
}

void add_recover(CLI::App& recording, ChosenCommand& chosen) {
  struct Options {
    std::string file, out;
  };
  auto o = std::make_shared<Options>();
  CLI::App* command =
      recording.add_subcommand("recover", "copy all that is whole of a damaged recording into a sound one");
  command->add_option("FILE", o->file, "damaged recording")->required();
  command->add_option("--out", o->out, "sound recording (default: FILE with .recovered.mcap)");
  finish_command(
      *command, chosen, [o](const CommonOptions& common, Progress& progress) -> Result<CommandOutput> {
        namespace fs = std::filesystem;
        const fs::path out =
            o->out.empty() ? fs::path(o->file).replace_extension(".recovered.mcap") : fs::path(o->out);
        GNATHION_CHECK_OK(may_write(out.string(), common, {o->file}));
        std::error_code ec;
        if (fs::equivalent(o->file, out, ec))
          return fail(ErrorCode::kUsage, "cannot recover", out.string(), "is the damaged recording itself");
        progress.begin_step("copying whole samples", 1.0);
        const fs::path part = out.string() + ".part";
        const auto count = recover_recording(o->file, part);
        if (!count) {
          fs::remove(part, ec);
          return tl::unexpected<Error>(count.error());
        }
        fs::rename(part, out, ec);
        if (ec) return fail(ErrorCode::kInternal, "cannot write", out.string(), ec.message());
        return CommandOutput{fmt::format("{} samples saved in {}\n", *count, out.string()),
                             json{{"samples", *count}, {"out", out.string()}}.dump(
                                 2, ' ', false, nlohmann::json::error_handler_t::replace),
                             false};
      });
}

}  // namespace

void add_recording_commands(CLI::App& app, ChosenCommand& chosen) {
  CLI::App* recording = app.add_subcommand("recording", "make recordings and look into them");
  recording->require_subcommand(1);
  add_recording_info(*recording, chosen);
  add_recover(*recording, chosen);
  add_capture(*recording, chosen);
  add_exchange_commands(*recording, chosen);
  add_shift_command(*recording, chosen);
}

}  // namespace gnathion
