#include "pipeline/motion_analysis.h"

#include <fmt/format.h>

#include <nlohmann/json.hpp>

#include "calibration/chain_json.h"
#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/motion_steps.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot analyse the jaw's motion";

struct Setting {
  const char* label;
  const char* name;
};
/// What is dialled into an articulator, in the order of its parts.
constexpr Setting kSettings[] = {
    {"sagittal condylar inclination at 5 mm", "sagittal_condylar_inclination_5mm"},
    {"sagittal condylar inclination at 3 mm", "sagittal_condylar_inclination_3mm"},
    {"Bennett angle at 5 mm", "bennett_angle_5mm"},
    {"Bennett angle at 3 mm", "bennett_angle_3mm"},
    {"immediate side shift", "immediate_side_shift"},
    {"progressive side shift", "progressive_side_shift"}};
constexpr Setting kMiddleSettings[] = {{"incisal guidance at 3 mm", "incisal_guidance_3mm"},
                                       {"hinge axis behind the incisal point", "hinge_axis_behind_incisal"},
                                       {"hinge axis above the incisal point", "hinge_axis_above_incisal"}};

json point_json(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

json number_json(const JawNumber& n) {
  json j = {{"name", n.name}, {"unit", n.unit}, {"determined", n.determined}, {"definition", n.definition}};
  if (!n.side.empty()) j["side"] = n.side;
  if (n.determined) {
    j["value"] = n.value;
    j["sigma"] = n.sigma;
    j["arc_s"] = {n.start_s, n.end_s};
    j["rows"] = n.rows;
  } else {
    j["value"] = nullptr;
    j["reason"] = n.reason;
  }
  return j;
}

std::string shown(const JawNumber* n) {
  return n == nullptr || !n->determined ? std::string("not determined")
                                        : fmt::format("{:.2f} ± {:.2f} {}", n->value, n->sigma, n->unit);
}

json hinge_json(const JawAnalysis& a) {
  if (!a.hinge) return {{"determined", false}, {"reason", a.hinge_reason}};
  const HingeAxis& h = *a.hinge;
  return {{"determined", true},
          {"point_mm", point_json(h.point_mm)},
          {"direction", point_json(h.direction)},
          {"misfit_mm", h.misfit_mm},
          {"expected_misfit_mm", h.expected_mm},
          {"migration_mm", h.migration_mm},
          {"migration_sigma_mm", h.migration_sigma_mm},
          {"chi2_per_dof", h.chi2_per_dof},
          {"largest_deg", h.largest_deg},
          {"rows", h.rows}};
}

json landmarks_json(const JawAnalysis& a) {
  const JawLandmarks& l = a.landmarks;
  json j = {{"incisal_mm", point_json(l.incisal_mm)},
            {"molar_left_mm", point_json(l.molar_left_mm)},
            {"molar_right_mm", point_json(l.molar_right_mm)},
            {"condyles_from", a.condyles_from.empty() ? json(nullptr) : json(a.condyles_from)},
            {"plane",
             {{"name", l.plane.name},
              {"left", point_json(l.plane.left)},
              {"anterior", point_json(l.plane.anterior)},
              {"up", point_json(l.plane.up)}}}};
  if (l.condyle_left_mm) {
    j["condyle_left_mm"] = point_json(*l.condyle_left_mm);
    j["condyle_right_mm"] = point_json(*l.condyle_right_mm);
  }
  return j;
}

/// A CSV field in quotes; ours hold no quotes themselves.
std::string quoted(const std::string& text) {
  return '"' + text + '"';
}

std::string numbers_csv(const JawAnalysis& a) {
  std::string csv = "name,side,value,sigma,unit,start_s,end_s,rows,determined,reason,definition\n";
  for (const JawNumber& n : a.numbers) {
    csv += fmt::format("{},{},", n.name, n.side);
    csv += n.determined ? fmt::format("{:.6g},{:.3g},{},{:.3f},{:.3f},{},1,", n.value, n.sigma, n.unit,
                                      n.start_s, n.end_s, n.rows)
                        : fmt::format(",,{},,,,0,", n.unit);
    csv += quoted(n.reason) + ',' + quoted(n.definition) + '\n';
  }
  return csv;
}

std::string paths_csv(const MotionAnalysis& m) {
  const JawLandmarks& l = m.analysis.landmarks;
  std::vector<std::pair<std::string, Vector3>> points = {
      {"incisal", l.incisal_mm}, {"molar_left", l.molar_left_mm}, {"molar_right", l.molar_right_mm}};
  if (l.condyle_left_mm)
    points.insert(points.end(),
                  {{"condyle_left", *l.condyle_left_mm}, {"condyle_right", *l.condyle_right_mm}});
  std::string csv = fmt::format(
      "# displacements from MI along the {} plane's directions; opening: rotation about the transverse axis\n"
      "time_s,movement,opening_deg",
      l.plane.name);
  for (const auto& [name, p] : points) csv += fmt::format(",{0}_left_mm,{0}_forward_mm,{0}_down_mm", name);
  csv += '\n';
  const std::vector<Rigid3> mandible = m.recording.mandible();
  for (std::size_t i = 0; i < mandible.size(); ++i) {
    const double t = m.recording.time_s[i];
    const char* movement = "";
    for (const JawSegment& s : m.analysis.segments)
      if (t >= s.start_s && t <= s.end_s) movement = name_of(s.movement);
    csv += fmt::format("{:.6f},{},{:.4f}", t, movement,
                       log_so3(mandible[i].rotation).dot(l.plane.left) * 180 / M_PI);
    for (const auto& [name, p] : points) {
      const Vector3 d = mandible[i] * p - p;
      csv +=
          fmt::format(",{:.4f},{:.4f},{:.4f}", l.plane.leftward(d), l.plane.forward(d), l.plane.downward(d));
    }
    csv += '\n';
  }
  return csv;
}

std::string chewing_csv(const JawAnalysis& a) {
  std::string csv = "start_s,end_s,period_s,opening_mm,width_mm,side\n";
  for (const ChewingCycle& c : a.cycles)
    csv += fmt::format("{:.3f},{:.3f},{},{:.3f},{:.3f},{}\n", c.start_s, c.end_s,
                       c.period_s > 0 ? fmt::format("{:.4f}", c.period_s) : std::string(), c.opening_mm,
                       c.width_mm, c.side);
  return csv;
}

std::string settings_csv(const JawAnalysis& a) {
  std::string csv = "setting,side,value,sigma,unit\n";
  const auto row = [&](const char* label, const char* name, const char* side) {
    const JawNumber* n = a.find(name, side);
    if (n == nullptr) return;
    csv += n->determined ? fmt::format("{},{},{:.4g},{:.2g},{}\n", label, side, n->value, n->sigma, n->unit)
                         : fmt::format("{},{},,,{}\n", label, side, n->unit);
  };
  for (const Setting& s : kSettings)
    for (const char* side : {"left", "right"}) row(s.label, s.name, side);
  for (const Setting& s : kMiddleSettings) row(s.label, s.name, "");
  if (a.landmarks.condyle_left_mm)
    csv += fmt::format("intercondylar distance,,{:.4g},,mm\n",
                       (*a.landmarks.condyle_left_mm - *a.landmarks.condyle_right_mm).norm());
  return csv;
}

Result<JawLandmarks> landmarks_for(const MotionAnalysisJob& job) {
  if (!job.landmarks.empty()) return read_landmarks(job.landmarks);
  if (job.maxilla.empty() || job.mandible.empty())
    return fail(ErrorCode::kUsage, kWhat, "landmarks", "give --landmarks, or --maxilla and --mandible");
  return landmarks_of_arches(job.maxilla, job.mandible);
}

Result<JawRecording> recording_of(const MotionAnalysisJob& job, const JawLandmarks& landmarks,
                                  std::vector<std::string>* notes) {
  if (job.motion.extension() == ".csv") {
    GNATHION_TRY(const JawMotion motion, read_motion_csv(job.motion));
    notes->push_back("read from a table: errors hold neither MI's nor the chain's part");
    return jaw_recording(motion);
  }
  if (job.calibration.empty())
    return fail(ErrorCode::kUsage, kWhat, job.motion.string(), "a chain is needed: --calibration chain.json");
  GNATHION_TRY(const PoseRecording poses, read_poses(job.motion));
  GNATHION_TRY(const SessionMotion session, to_session_motion(poses, job.motion.string()));
  GNATHION_TRY(const json chain_file, read_json(job.calibration));
  GNATHION_TRY(const Chain chain, chain_from_json(chain_file, job.calibration.string()));
  PlateauOptions options = job.plateaus;
  options.point_in_bow_mm = chain.t_d() * landmarks.incisal_mm;
  GNATHION_TRY(const JawPositions positions, find_mi(session, options));
  *notes = positions.notes;
  return jaw_recording(session, positions.head_from_bow_mi,
                       {chain.t_d(), chain.bow_from_dental.covariance + mount_covariance(session)});
}

}  // namespace

Result<MotionAnalysis> analyse_motion(const MotionAnalysisJob& job, Progress& progress) {
  progress.begin_step("analysing the jaw's motion", 1.0);
  GNATHION_TRY(const JawLandmarks landmarks, landmarks_for(job));
  MotionAnalysis m;
  std::vector<std::string> notes;
  GNATHION_TRY(m.recording, recording_of(job, landmarks, &notes));
  GNATHION_TRY(m.analysis, analyse_jaw_motion(m.recording, landmarks, job.options));
  m.analysis.notes.insert(m.analysis.notes.begin(), notes.begin(), notes.end());
  return m;
}

json motion_analysis_json(const MotionAnalysis& m) {
  const JawAnalysis& a = m.analysis;
  json j = {{"kind", "jaw motion"},
            {"landmarks", landmarks_json(a)},
            {"hinge_axis", hinge_json(a)},
            {"notes", a.notes}};
  j["opening_pattern"] = a.opening_pattern.empty() ? json(nullptr) : json(a.opening_pattern);
  j["chewing_side"] = a.chewing_side.empty() ? json(nullptr) : json(a.chewing_side);
  j["segments"] = j["numbers"] = j["chewing"] = json::array();
  for (const JawSegment& s : a.segments)
    j["segments"].push_back({{"movement", name_of(s.movement)},
                             {"start_s", s.start_s},
                             {"turn_s", s.turn_s},
                             {"end_s", s.end_s},
                             {"source", s.source},
                             {"cut_by_gap", s.cut}});
  for (const JawNumber& n : a.numbers) j["numbers"].push_back(number_json(n));
  for (const ChewingCycle& c : a.cycles)
    j["chewing"].push_back({{"start_s", c.start_s},
                            {"end_s", c.end_s},
                            {"period_s", c.period_s > 0 ? json(c.period_s) : json(nullptr)},
                            {"opening_mm", c.opening_mm},
                            {"width_mm", c.width_mm},
                            {"side", c.side}});
  json settings = json::array();
  for (const Setting& s : kSettings) {
    json row = {{"setting", s.label}};
    for (const char* side : {"left", "right"}) {
      const JawNumber* n = a.find(s.name, side);
      row[side] = n == nullptr || !n->determined
                      ? json(nullptr)
                      : json{{"value", n->value}, {"sigma", n->sigma}, {"unit", n->unit}};
    }
    settings.push_back(row);
  }
  j["articulator"] = settings;
  return j;
}

std::string motion_analysis_text(const MotionAnalysis& m) {
  const JawAnalysis& a = m.analysis;
  std::string text;
  for (const Setting& s : kSettings)
    text += fmt::format("{:<40} left {:<24} right {}\n", s.label, shown(a.find(s.name, "left")),
                        shown(a.find(s.name, "right")));
  for (const Setting& s : kMiddleSettings) text += fmt::format("{:<40} {}\n", s.label, shown(a.find(s.name)));
  text += fmt::format("{:<40} {}{}\n", "opening", shown(a.find("opening")),
                      a.opening_pattern.empty() ? "" : ", " + a.opening_pattern);
  text += fmt::format("{:<40} {}\n", "protrusion", shown(a.find("protrusion")));
  text += fmt::format("{:<40} left {:<24} right {}\n", "laterotrusion",
                      shown(a.find("laterotrusion", "left")), shown(a.find("laterotrusion", "right")));
  text += fmt::format("{:<40} {} cycles, period {}, {}\n", "chewing", a.cycles.size(),
                      shown(a.find("chewing_period")),
                      a.chewing_side.empty() ? "side not determined" : "side: " + a.chewing_side);
  if (!a.hinge) text += "hinge axis not determined: " + a.hinge_reason + '\n';
  for (const std::string& note : a.notes) text += "note: " + note + '\n';
  return text;
}

Status write_motion_analysis(const MotionAnalysis& m, const MotionAnalysisJob& job, const fs::path& folder) {
  json j = motion_analysis_json(m);
  j["inputs"] = json::array();
  for (const fs::path& p : {job.motion, job.calibration, job.landmarks, job.maxilla, job.mandible}) {
    if (p.empty()) continue;
    GNATHION_TRY(const std::string sha, sha256_of_file(p));
    j["inputs"].push_back({{"path", p.filename().string()}, {"sha256", sha}});
  }
  GNATHION_CHECK_OK(write_json(folder / "analysis.json", j));
  GNATHION_CHECK_OK(write_file(folder / "numbers.csv", numbers_csv(m.analysis)));
  GNATHION_CHECK_OK(write_file(folder / "paths.csv", paths_csv(m)));
  GNATHION_CHECK_OK(write_file(folder / "chewing.csv", chewing_csv(m.analysis)));
  GNATHION_CHECK_OK(write_file(folder / "settings.csv", settings_csv(m.analysis)));
  if (!job.pictures) return {};
  std::error_code ec;
  fs::create_directories(folder / "pictures", ec);
  if (ec) return fail(ErrorCode::kInternal, "cannot write", (folder / "pictures").string(), ec.message());
  return draw_motion_analysis(m, folder / "pictures");
}

}  // namespace gnathion
