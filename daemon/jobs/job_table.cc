#include "daemon/jobs/job_table.h"

#include <fmt/format.h>

namespace gnathion::daemon {
namespace {

using T = OptionType;

JobOption required(const char* name, T type, bool repeated = false) {
  return {name, type, true, repeated};
}
JobOption optional(std::string name, T type, bool repeated = false) {
  return {std::move(name), type, false, repeated};
}

JobKind kind(const char* name, const char* help, std::vector<std::string> words,
             std::vector<JobOption> options) {
  return {name, help, std::move(words), false, std::move(options)};
}

/// Where the joints are, as cli/patient_options.cc has it.
std::vector<JobOption> with_joints(std::vector<JobOption> options) {
  options.insert(options.end(), {optional("cbct", T::kInput), optional("series", T::kText),
                                 optional("bone-level", T::kNumber), optional("cbct-pose", T::kInput),
                                 optional("labels", T::kInput), optional("condyle-labels", T::kNumbers),
                                 optional("fossa-labels", T::kNumbers)});
  for (const char* side : {"left", "right"})
    for (const char* place : {"condyle", "fossa", "box"})
      options.push_back(optional(fmt::format("{}-{}", place, side), T::kNumbers));
  return options;
}

std::vector<JobKind> calibrations() {
  return {
      kind("calibrate camera", "intrinsics of a camera from images of a board", {"calibrate", "camera"},
           {optional("images", T::kInput), optional("recording", T::kInput), required("board", T::kText),
            optional("name", T::kText), optional("without-k3", T::kFlag), optional("max-frames", T::kNumber),
            required("out", T::kOutput)}),
      kind("calibrate rig", "two or more cameras that see the board at the same instants",
           {"calibrate", "rig"},
           {required("recording", T::kInput), required("board", T::kText),
            optional("streams", T::kText, true), optional("same-instant-ms", T::kNumber),
            optional("pair-by", T::kText), optional("without-k3", T::kFlag),
            optional("max-frames", T::kNumber), required("out", T::kOutput)}),
      kind("calibrate time", "the constant offset in time between two streams of poses",
           {"calibrate", "time"},
           {required("recording", T::kInput, true), required("streams", T::kText, true),
            optional("max-offset-s", T::kNumber), required("out", T::kOutput)}),
      kind("calibrate bow", "tag corners of bow or head frame from a film of it", {"calibrate", "bow"},
           {required("recording", T::kInput), required("rig", T::kInput), required("bow", T::kInput),
            required("out", T::kOutput), optional("bow-out", T::kOutput), optional("tag-side-mm", T::kNumber),
            optional("tag-side-sigma-mm", T::kNumber), optional("distance", T::kText, true),
            optional("interval-s", T::kNumber)}),
      kind("calibrate chain", "T_D, T_F, T and T_B from scans of bow, teeth and face", {"calibrate", "chain"},
           {required("mandible-mi", T::kInput), required("clutch-scan", T::kInput, true),
            required("bow-model", T::kInput), optional("face-mi", T::kInput, true),
            optional("face-tp", T::kInput, true), optional("head-frame-model", T::kInput),
            optional("motion", T::kInput), required("out", T::kOutput)}),
  };
}

std::vector<JobKind> motions() {
  return {
      kind("track", "a recording becomes the poses of bow and head frame", {"track"},
           {required("recording", T::kInput), optional("rig", T::kInput),
            optional("electromagnetic", T::kInput), optional("csv", T::kOutput), optional("smooth", T::kFlag),
            optional("smoothed-csv", T::kOutput), required("out", T::kOutput)}),
      kind("transform scans", "T_th from intraoral scans in MI and in TP", {"transform", "scans"},
           {required("maxilla-mi", T::kInput), required("mandible-mi", T::kInput),
            required("maxilla-tp", T::kInput), required("mandible-tp", T::kInput),
            required("out", T::kOutput)}),
      kind("transform motion", "T_th from a tracked motion and the chain", {"transform", "motion"},
           {required("motion", T::kInput), required("calibration", T::kInput), optional("mi-s", T::kText),
            optional("tp-s", T::kText), optional("accept-slip", T::kFlag), required("out", T::kOutput)}),
      kind("check", "can a splint realize this transformation?", {"check"},
           with_joints({required("maxilla", T::kInput), required("mandible", T::kInput),
                        required("transform", T::kInput), optional("motion", T::kInput),
                        optional("calibration", T::kInput), required("out", T::kOutput)})),
  };
}

std::vector<JobKind> splints() {
  JobKind run = kind(
      "run", "everything the case asks for, in order; only what has changed", {"run"},
      {optional("accept-slip", T::kFlag), optional("config", T::kInput), optional("set", T::kText, true)});
  run.takes_case = true;
  JobKind report = run;
  report.name = "report";
  report.help = "the case's report made anew, with whatever it rests on and has changed";
  return {
      kind("design", "a splint that holds the mandible where T_th puts it", {"design"},
           with_joints({required("maxilla", T::kInput), required("mandible", T::kInput),
                        required("transform", T::kInput), optional("arch", T::kText),
                        optional("occlusal-surface", T::kInput), optional("mandible-pose", T::kText),
                        optional("motion", T::kInput), optional("calibration", T::kInput),
                        optional("recording", T::kInput), optional("config", T::kInput),
                        optional("set", T::kText, true), optional("tooth", T::kText, true),
                        optional("margin", T::kInput, true), optional("label", T::kText),
                        optional("kind", T::kText), optional("no-pictures", T::kFlag),
                        required("out", T::kOutput)})),
      kind("evaluate", "printed against planned", {"evaluate"},
           {required("design", T::kInput),
            required("scan-splint", T::kInput),
            optional("scan-maxilla", T::kInput),
            optional("scan-mandible", T::kInput),
            optional("scan-splint-free", T::kInput),
            optional("maxilla", T::kInput),
            optional("mandible", T::kInput),
            optional("mandible-pose", T::kText),
            optional("transform", T::kInput),
            optional("name", T::kText),
            optional("other-design", T::kInput, true),
            optional("seat-region", T::kText),
            optional("max-avg-mm", T::kNumber),
            optional("max-std-mm", T::kNumber),
            optional("max-alpha-deg", T::kNumber),
            optional("max-t-mm", T::kNumber),
            optional("max-tooth-mm", T::kNumber),
            optional("equivalence-mm", T::kNumber),
            optional("seed", T::kNumber),
            optional("no-pictures", T::kFlag),
            required("out", T::kOutput)}),
      run,
      report,
  };
}

}  // namespace

const std::vector<JobKind>& job_kinds() {
  static const std::vector<JobKind> kinds = [] {
    std::vector<JobKind> all = calibrations();
    for (JobKind& k : motions()) all.push_back(std::move(k));
    for (JobKind& k : splints()) all.push_back(std::move(k));
    return all;
  }();
  return kinds;
}

const JobKind* find_job_kind(const std::string& name) {
  for (const JobKind& kind : job_kinds())
    if (kind.name == name) return &kind;
  return nullptr;
}

}  // namespace gnathion::daemon
