#include "viewer/model/daemon_requests.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/transform_io.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kFolder = "jobs";

/// "jobs/T_th_003.json", the first that is not there.
std::string unused(const CaseContent& c, const std::string& folder, const std::string& stem,
                   const std::string& extension) {
  std::error_code ec;
  for (int i = 1;; ++i) {
    const std::string path = fmt::format("{}/{}_{:03}{}", folder, stem, i, extension);
    if (!fs::exists(c.folder / path, ec)) return path;
  }
}

/// A request under construction; the first thing that is missing is its answer.
class Order {
 public:
  Order(const CaseContent& content, const char* kind) : content_(content) { request_.kind = kind; }

  Order& input(const char* name, const fs::path& path, const char* what) {
    if (path.empty()) return missing(std::string(what) + " is missing");
    optional_input(name, path);
    return *this;
  }
  Order& optional_input(const char* name, const fs::path& path) {
    if (path.empty()) return *this;
    std::error_code ec;
    if (!fs::exists(path, ec)) return missing(path.filename().string() + " does not exist");
    const fs::path inside = fs::relative(path, content_.folder, ec);
    if (ec || inside.empty() || *inside.begin() == "..")
      return missing(path.filename().string() + " lies outside the case's folder");
    return value(name, inside.string());
  }
  Order& value(const char* name, const std::string& text) {
    request_.values.emplace_back(name, text);
    return *this;
  }
  Order& output(const std::string& path) {
    std::error_code ec;
    fs::create_directories((content_.folder / path).parent_path(), ec);
    return value("out", path);
  }
  Order& missing(const std::string& why) {
    if (why_.empty()) why_ = why;
    return *this;
  }
  Result<client::JobRequest> done() {
    if (!why_.empty()) return fail(ErrorCode::kUsage, "cannot submit", request_.kind, why_);
    return std::move(request_);
  }

 private:
  const CaseContent& content_;
  client::JobRequest request_;
  std::string why_;
};

/// The window's T_th as a file of the case.
Order& add_transform(Order& order, const CaseContent& c, const SessionState& s) {
  if (!s.therapeutic) return order.missing("T_th is not set yet: set it in the Transformation step");
  std::error_code ec;
  fs::create_directories(c.folder / kFolder, ec);
  const fs::path path = c.folder / unused(c, kFolder, "T_th_of_window", ".json");
  const Status written = write_json(
      path, motion_json(Motion<Dental>(*s.therapeutic), std::nullopt, {{"from", s.therapeutic_source}}));
  if (!written) return order.missing(written.error().line());
  return order.input("transform", path, "T_th");
}

Result<client::JobRequest> run_request(const CaseContent& c, const SessionState&) {
  return Order(c, "run").done();
}
Result<client::JobRequest> report_request(const CaseContent& c, const SessionState&) {
  return Order(c, "report").done();
}
Result<client::JobRequest> track_request(const CaseContent& c, const SessionState&) {
  return Order(c, "track")
      .input("recording", c.files.recording, "a recording (Capture makes one)")
      .input("rig", c.files.rig, "the rig of the cameras ([session] rig in case.toml)")
      .output(unused(c, kFolder, "track", ".mcap"))
      .done();
}
Result<client::JobRequest> chain_request(const CaseContent& c, const SessionState&) {
  Order order(c, "calibrate chain");
  order.input("mandible-mi", c.files.mandible_mi, "the lower scan")
      .input("clutch-scan", c.files.mandible_clutch, "the scan with the clutch")
      .input("bow-model", c.files.bow_model, "the model of the bow");
  if (!c.files.face_mi.empty() && !c.files.face_tp.empty() && !c.files.head_frame_model.empty())
    order.input("face-mi", c.files.face_mi, "")
        .input("face-tp", c.files.face_tp, "")
        .input("head-frame-model", c.files.head_frame_model, "");
  return order.output(unused(c, kFolder, "chain", ".json")).done();
}
Result<client::JobRequest> scans_request(const CaseContent& c, const SessionState&) {
  return Order(c, "transform scans")
      .input("maxilla-mi", c.files.maxilla_mi, "the upper scan in MI")
      .input("mandible-mi", c.files.mandible_mi, "the lower scan in MI")
      .input("maxilla-tp", c.files.maxilla_tp, "the upper scan in TP")
      .input("mandible-tp", c.files.mandible_tp, "the lower scan in TP")
      .output(unused(c, kFolder, "T_th_scans", ".json"))
      .done();
}
Result<client::JobRequest> motion_request(const CaseContent& c, const SessionState& s) {
  Order order(c, "transform motion");
  // What the window shows: of the results, or of a job that ended later.
  order.input("motion", newest_result(c.folder, "motion.mcap", "track", ".mcap"), "the tracked motion")
      .input("calibration", newest_result(c.folder, "chain.json", "chain", ".json"), "the chain");
  const auto interval = [](const std::pair<double, double>& i) {
    return fmt::format("{:.4f}..{:.4f}", i.first, i.second);
  };
  if (s.mi_s) order.value("mi-s", interval(*s.mi_s));
  if (s.tp_s) order.value("tp-s", interval(*s.tp_s));
  return order.output(unused(c, kFolder, "T_th_motion", ".json")).done();
}
Result<client::JobRequest> check_request(const CaseContent& c, const SessionState& s) {
  Order order(c, "check");
  order.input("maxilla", c.files.maxilla_mi, "the upper scan")
      .input("mandible", c.files.mandible_mi, "the lower scan")
      .optional_input("cbct", c.files.cbct);
  return add_transform(order, c, s).output(unused(c, kFolder, "feasibility", ".json")).done();
}

}  // namespace

const std::vector<DaemonTask>& daemon_tasks(Step step) {
  static const DaemonTask run = {"daemonRun", "Run the case",
                                 "Everything the case asks for, in order; only what has changed",
                                 JobAfter::kReadCase, run_request};
  static const std::map<Step, std::vector<DaemonTask>> tasks = {
      {Step::kMotion,
       {{"daemonTrack", "Track", "Poses of bow and head frame from the recording", JobAfter::kReadCase,
         track_request},
        run}},
      {Step::kCalibrate,
       {{"daemonCalibrate", "Calibrate", "Solves the chain from the scans of bow, teeth and face",
         JobAfter::kReadCase, chain_request}}},
      {Step::kTransformation,
       {{"daemonScans", "T_th from scans", "From the scans in MI and in TP; undo takes it back",
         JobAfter::kTakeTransform, scans_request},
        {"daemonMotion", "from motion",
         "From the tracked motion, the chain, and the intervals picked in Motion", JobAfter::kTakeTransform,
         motion_request},
        {"daemonCheck", "Check", "Can a splint realize this T_th? With the joints, where there is a CBCT",
         JobAfter::kShowVerdict, check_request}}},
      {Step::kEvaluate,
       {{"daemonReport", "Report", "The case's report made anew", JobAfter::kReadCase, report_request}}}};
  static const std::vector<DaemonTask> none;
  const auto at = tasks.find(step);
  return at == tasks.end() ? none : at->second;
}

Result<client::JobRequest> design_request(const CaseContent& c, const SessionState& s) {
  Order order(c, "design");
  order.input("maxilla", c.files.maxilla_mi, "the upper scan")
      .input("mandible", c.files.mandible_mi, "the lower scan")
      .value("arch", s.arch == Arch::kMaxilla ? "maxilla" : "mandible")
      .value("no-pictures", "true");
  add_transform(order, c, s);
  const nlohmann::json defaults = parameters_json(SplintParameters{}), ours = parameters_json(s.parameters);
  for (const auto& [name, value] : ours.items())
    if (value.is_number() && value != defaults.value(name, nlohmann::json()))
      order.value("set", fmt::format("design.{}={}", name, value.get<double>()));
  if (!s.edits.empty()) {
    const fs::path path = c.folder / unused(c, kFolder, "edits_of_window", ".toml");
    const Status written = write_file(path, edits_toml(s.edits));
    if (!written) order.missing(written.error().line());
    order.input("config", path, "");
  }
  return order.output(unused(c, "designs", "design", "")).done();
}

Result<client::JobRequest> evaluate_request(const CaseContent& c, const fs::path& splint,
                                            const fs::path& maxilla, const fs::path& mandible) {
  return Order(c, "evaluate")
      .input("design", c.results(), "")
      .input("scan-splint", splint, "the scan of the splint in place")
      .optional_input("scan-maxilla", maxilla)
      .optional_input("scan-mandible", mandible)
      .input("maxilla", c.files.maxilla_mi, "the upper scan")
      .input("mandible", c.files.mandible_mi, "the lower scan")
      .input("transform", c.results() / "T_th.json", "")
      .value("no-pictures", "true")
      .output(unused(c, "evaluations", "evaluation", ""))
      .done();
}

std::string output_of(const client::JobRequest& request) {
  for (const auto& [name, value] : request.values)
    if (name == "out") return value;
  return {};
}

fs::path newest_result(const fs::path& folder, const std::string& file, const std::string& stem,
                       const std::string& extension) {
  const fs::path result = folder / "results" / file;
  fs::path last;
  std::error_code ec;
  for (int i = 1; i < 1000; ++i) {
    const fs::path at = folder / kFolder / fmt::format("{}_{:03}{}", stem, i, extension);
    if (!fs::exists(at, ec)) break;
    last = at;
  }
  const bool later = !last.empty() && (!fs::exists(result, ec) ||
                                       fs::last_write_time(last, ec) > fs::last_write_time(result, ec));
  return later ? last : result;
}

}  // namespace gnathion
