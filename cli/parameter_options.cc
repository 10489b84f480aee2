#include "cli/parameter_options.h"

#include <algorithm>
#include <sstream>

#include <fmt/format.h>

#include <CLI/CLI.hpp>

#include "core/file.h"

namespace gnathion {

void add_parameter_options(CLI::App& command, ParameterOptions& o) {
  command.add_option("--config", o.config, "TOML file with a [design] table, and edits by hand");
  std::string names;
  for (const ParameterHelp& p : parameter_help())
    names += fmt::format("\n    design.{}={} [{}] {}..{}", p.name, p.default_value, p.unit, p.low, p.high);
  command.add_option("--set", o.set,
                     "one parameter, design.NAME=VALUE; repeatable. Defaults and ranges:" + names);
}

void add_edit_options(CLI::App& command, ParameterOptions& o) {
  command.add_option(
      "--tooth", o.teeth,
      "corrects the teeth found: 16=missing, or 24=x,y,z (a point on it as its file has it, mm); "
      "repeatable");
  command.add_option(
      "--margin", o.margins,
      "margin curve to trim at instead of the cutting plane: a text file, x y z (mm, as the arch's "
      "file has it) a line; repeatable");
  command.add_option("--label", o.label, "text to emboss where there is room");
  command
      .add_option(
          "--kind", o.kind,
          "positioning (contacts of MI), or a stabilisation splint with guidance ramps: flat (parallel to "
          "the occlusal plane), flat-fitted (least clearance to the opposing tips)")
      ->check(CLI::IsMember({"positioning", "flat", "flat-fitted"}));
}

Result<SplintParameters> effective_parameters(const ParameterOptions& o, const SplintParameters& base) {
  SplintParameters p = base;
  if (!o.config.empty()) {
    GNATHION_TRY(p, read_parameters(o.config, p));
  }
  for (const std::string& s : o.set) GNATHION_CHECK_OK(set_parameter(p, s));
  if (!o.kind.empty()) p.flat_plane = o.kind == "flat" ? 1.0 : o.kind == "flat-fitted" ? 2.0 : 0.0;
  GNATHION_CHECK_OK(check_parameters(p));
  return p;
}

namespace {

/// The points of a text file, one a line; lines with # are comments.
Result<MarginCurve> read_margin(const std::string& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  MarginCurve margin;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    std::replace(line.begin(), line.end(), ',', ' ');
    if (line.find_first_not_of(" \t\r") == std::string::npos || line[0] == '#') continue;
    std::istringstream words(line);
    Vector3 p;
    std::string more;
    if (!(words >> p.x() >> p.y() >> p.z()) || words >> more || !p.allFinite())
      return bad_input("cannot read margin", fmt::format("{}:{}", path, number),
                       "not three numbers (x y z, mm)");
    margin.points_mm.push_back(p);
  }
  if (margin.points_mm.size() < 2)
    return bad_input("cannot read margin", path, "two points or more are needed");
  return margin;
}

}  // namespace

Result<SplintEdits> effective_edits(const ParameterOptions& o, const SplintEdits& base) {
  SplintEdits edits = base;
  if (!o.config.empty()) {
    GNATHION_TRY(const std::string text, read_file(o.config));
    GNATHION_TRY(SplintEdits drawn, parse_edits(text, o.config));
    // Kind by kind: a file with a label alone keeps the case's strokes.
    if (!drawn.strokes.empty()) edits.strokes = std::move(drawn.strokes);
    if (!drawn.cutouts.empty()) edits.cutouts = std::move(drawn.cutouts);
    if (!drawn.contacts.empty()) edits.contacts = std::move(drawn.contacts);
    if (!drawn.teeth.empty()) edits.teeth = std::move(drawn.teeth);
    if (!drawn.margins.empty()) edits.margins = std::move(drawn.margins);
    if (!drawn.label.empty()) edits.label = std::move(drawn.label);
  }
  for (const std::string& tooth : o.teeth) GNATHION_CHECK_OK(add_tooth_correction(edits.teeth, tooth));
  for (const std::string& path : o.margins) {
    GNATHION_TRY(MarginCurve margin, read_margin(path));
    edits.margins.push_back(std::move(margin));
  }
  if (!o.label.empty()) {
    GNATHION_CHECK_OK(check_label(o.label));
    edits.label = o.label;
  }
  return edits;
}

}  // namespace gnathion
