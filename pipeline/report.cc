#include "pipeline/report.h"

#include <fmt/format.h>

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/file.h"
#include "core/xml.h"
#include "pipeline/displacement_steps.h"
#include "pipeline/provenance.h"
#include "pipeline/run_case.h"
#include "pipeline/version.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

constexpr const char* kStyle = R"css(
body{font:15px/1.45 system-ui,sans-serif;color:#1c2430;max-width:1100px;margin:2em auto;padding:0 1em}
h1{font-size:1.6em;margin-bottom:.1em}h2{font-size:1.15em;margin-top:1.6em;border-bottom:1px solid #ccd}
.note{background:#fff6df;border:1px solid #e6d08c;padding:.5em .8em}
.pass{color:#116329;font-weight:600}.fail{color:#a40e26;font-weight:600}
table{border-collapse:collapse;margin:.6em 0}td,th{padding:.2em .8em .2em 0;text-align:left;border-bottom:1px solid #e4e7ee}
td.n,th.n{text-align:right;font-variant-numeric:tabular-nums}
.pictures{display:grid;grid-template-columns:1fr 1fr;gap:14px}figure{margin:0}img{width:100%;border:1px solid #dde}
figcaption{font-size:.85em;color:#556}
)css";

std::string row(const std::vector<std::string>& cells, const char* tag = "td") {
  std::string text = "<tr>";
  for (std::size_t i = 0; i < cells.size(); ++i)
    text += fmt::format("<{}{}>{}</{}>", tag, i == 0 ? "" : " class=n", cells[i], tag);
  return text + "</tr>\n";
}

std::string motion_section(const CaseResults& r) {
  const Rigid3& t = r.therapeutic.therapeutic.value.rigid;
  std::string text =
      fmt::format("<h2>Therapeutic transformation</h2><p>Rotation {:.3f}°.", t.angle_rad() * 180 / M_PI);
  if (r.comparison)
    text += fmt::format(
        " The camera and the face scans give T_th independently: they differ by at most {:.3f} mm and "
        "{:.3f}° ({}).",
        r.comparison->largest_mm, r.comparison->angle_deg,
        r.comparison->consistent
            ? "within their stated errors; the two are fused by their covariances"
            : "<span class=fail>more than their stated errors allow: the camera alone is used</span>");
  text += "</p><table>" + row({"point of the mandible", "displacement [mm]", "95 % bound [mm]"}, "th");
  for (std::size_t i = 0; i < r.landmarks.size(); ++i)
    text += row({r.landmark_names[i], fmt::format("{:.3f}", r.landmarks[i].length_mm),
                 r.covariance_known ? fmt::format("{:.3f}", r.landmarks[i].bound95_mm) : "unknown"});
  text += "</table><p>As a screw the mandible " + screw_text(r.screw, r.covariance_known) + ".</p>";
  for (const std::string& note : r.frame_notes) text += "<p class=fail>" + xml_escaped(note) + "</p>";
  return text;
}

std::string recording_section(const CaseResults& r) {
  std::size_t valid = 0;
  for (const MotionRow& m : r.session.rows) valid += m.valid();
  std::string text =
      fmt::format("<h2>Recording</h2><p>{} camera frames, {} of them with bow and head frame.</p><table>",
                  r.session.rows.size(), valid);
  text += row({"rest", "from [s]", "to [s]", "frames", "dispersion [mm]"}, "th");
  const auto add = [&](const char* name, const std::vector<Plateau>& plateaus) {
    for (const Plateau& p : plateaus)
      text += row({fmt::format("{} ({})", name, p.source), fmt::format("{:.2f}", p.start_s),
                   fmt::format("{:.2f}", p.end_s), std::to_string(p.frames),
                   fmt::format("{:.4f}", p.dispersion_mm)});
  };
  add("MI", r.camera.positions.mi);
  add("TP", r.camera.positions.tp);
  text += "</table><p>";
  for (const Closure& c : r.camera.positions.closures)
    text += fmt::format("MI {} against MI {}: {:.4f} mm, {:.4f}° ({:.1f} σ). ", c.second + 1, c.first + 1,
                        c.distance_mm, c.angle_deg, c.sigmas);
  text += "</p>";
  for (const std::string& w : r.session.warnings) text += "<p class=fail>" + xml_escaped(w) + "</p>";
  return text;
}

std::string chain_section(const Chain& chain) {
  std::string text = "<h2>Chain of frames</h2><table>" +
                     row({"registration", "rms [mm]", "held out [mm]", "condition"}, "th");
  const auto add = [&](const char* name, const ChainPose& p) {
    text += row({name, fmt::format("{:.3f}", p.rms_mm), fmt::format("{:.3f}", p.held_out_mm),
                 fmt::format("{:.0f}", p.condition)});
    for (const std::string& w : p.weak) text += row({"&nbsp;&nbsp;" + xml_escaped(w)});
  };
  add("T_D, bow from dental", chain.bow_from_dental);
  if (chain.has_faces) {
    add("T_F, bow from face scan (MI)", chain.bow_from_face);
    add("bow from face scan (TP)", chain.bow_from_face_tp);
    add("upper face, MI from TP", chain.face_mi_from_face_tp);
  }
  text += "</table>";
  if (chain.has_faces)
    text += fmt::format(
        "<p>Face scans: deviation {:.3f} mm (MI), {:.3f} mm (TP) on the bow; T_F predicted to {:.3f} and "
        "{:.3f} mm "
        "RMS at the teeth, {:.2f} allowed.</p>",
        chain.face_mi.deviation_mm, chain.face_tp.deviation_mm, chain.face_mi.at_teeth_mm,
        chain.face_tp.at_teeth_mm, kLargestFaceScanError_mm);
  for (const std::string& w : chain.warnings) text += "<p class=fail>" + xml_escaped(w) + "</p>";
  return text + "<p>A residual is not an accuracy; the bounds above come from the covariances.</p>";
}

std::string number(const json& j) {
  if (j.is_number_integer()) return std::to_string(j.get<long long>());
  if (j.is_number()) return fmt::format("{:.4g}", j.get<double>());
  return j.is_null() ? "not checked" : xml_escaped(j.is_string() ? j.get<std::string>() : j.dump());
}

std::string check_section(const CaseResults& r) {
  const json& j = *r.design.feasibility;
  std::string text = fmt::format("<h2>Can it be realized?</h2><p>{}</p><table>", number(j["verdict"]));
  text += row({"constraint", "value", "limit", "unit", ""}, "th");
  for (const json& c : j["constraints"]) {
    const bool pass = c["pass"].is_boolean() && c["pass"].get<bool>() && !c["value"].is_null();
    text += row({number(c["name"]), number(c["value"]), number(c["limit"]), number(c["unit"]),
                 pass ? "<span class=pass>pass</span>" : number(c["consequence"])});
  }
  text += "</table>";
  for (const json& note : j["notes"]) text += "<p>" + number(note) + "</p>";
  return text;
}

std::string design_section(const CaseResults& r) {
  const json& j = *r.design.report;
  const bool pass = r.design.accepted();
  std::string text = fmt::format("<h2>Splint</h2><p>Verdict: <span class={}>{}</span></p>",
                                 pass ? "pass" : "fail", number(j["verdict"]));
  text += "<table>" + row({"gate", "value", "limit", ""}, "th");
  for (const json& g : j["gates"]) {
    const bool ok = g["pass"].get<bool>();
    text += row({number(g["name"]), number(g["value"]), number(g["limit"]),
                 fmt::format("<span class={}>{}</span>", ok ? "pass" : "fail", ok ? "pass" : "fail")});
  }
  text += "</table>";
  if (j["warnings"].empty()) return text;
  text += fmt::format("<details><summary>{} warning(s)</summary><ul>", j["warnings"].size());
  for (const json& w : j["warnings"]) text += "<li>" + number(w) + "</li>";
  return text + "</ul></details>";
}

Result<std::string> pictures_section(const std::vector<fs::path>& made_in) {
  const std::pair<const char*, const char*> pictures[] = {
      {"splint_on_maxilla.png", "The splint on the maxilla."},
      {"splint_cavity.png", "The splint's cavity."},
      {"jaws_in_tp.png", "With the mandible in the therapeutic position."},
      {"jaws_in_tp_right.png", "The same from the right."},
      {"section_molar.png", "Cross-section at the left first molar."},
      {"section_premolar.png", "Cross-section at the left first premolar."},
      {"section_incisor.png", "Cross-section at the left central incisor."},
      {"error_map.png", "How sure the mandible's place in TP is: 95 % bound, seen from the occlusal side."},
      {"jaw_path.png", "Path of the lower incisal point."},
      {"jaw_motion.png", "The same over time."}};
  std::string text = "<h2>Pictures</h2><div class=pictures>\n";
  for (const auto& [name, caption] : pictures) {
    std::error_code ec;
    const auto folder = std::find_if(made_in.begin(), made_in.end(), [&, n = name](const fs::path& f) {
      return fs::exists(f / "pictures" / n, ec);
    });
    if (folder == made_in.end()) continue;  // no splint, no pictures of it
    GNATHION_TRY(const std::string png, read_file(*folder / "pictures" / name));
    text += fmt::format(
        "<figure><img alt=\"{}\" src=\"data:image/png;base64,{}\"><figcaption>{}</figcaption></figure>\n",
        caption, base64(png), caption);
  }
  return text + "</div>";
}

std::string inputs_section(const CaseResults& r) {
  std::string text = "<h2>Inputs</h2><table>" + row({"file", "SHA-256"}, "th");
  for (const json& f : (*r.design.report)["inputs"])
    text += row({xml_escaped(fs::path(f["path"].get<std::string>()).filename().string()),
                 "<code>" + number(f["sha256"]) + "</code>"});
  return text + "</table>";
}

std::string provenance_section(const CaseResults& r, const StepRecord& record) {
  std::string text = fmt::format(
      "<h2>Where this comes from</h2><p>Case {}, gnathion {}, {}. <code>gnathion case provenance</code> "
      "tells the "
      "whole way back.</p><table>",
      xml_escaped(r.case_id), record.program, record.time);
  text += row({"made from", "SHA-256"}, "th");
  for (const FileRecord& f : record.inputs)
    text += row({xml_escaped(f.path), "<code>" + f.sha256 + "</code>"});
  return text + "</table>";
}

}  // namespace

Status write_report(const CaseResults& r, const std::vector<fs::path>& made_in, const StepRecord& record,
                    const fs::path& folder) {
  GNATHION_TRY(const std::string pictures, pictures_section(made_in));
  const bool measured = r.route == PositionRoute::kMeasured;
  const std::string html = fmt::format(
      "<!doctype html><html lang=en><meta charset=utf-8><title>Gnathion report {0}</title><style>{1}</style>"
      "<h1>Occlusal positioning splint</h1><p>Case {0}, gnathion {2}</p>"
      "<p class=note>Research use only. This report makes no clinical "
      "claim.</p>{3}{4}{5}{6}{7}{8}{9}{10}</html>\n",
      xml_escaped(r.case_id), kStyle, kVersion, motion_section(r), design_section(r), pictures,
      check_section(r), measured ? recording_section(r) : "", measured ? chain_section(r.chain) : "",
      inputs_section(r), provenance_section(r, record));
  return write_file(folder / "report.html", html);
}

}  // namespace gnathion
