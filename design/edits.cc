#include "design/edits.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#define TOML_EXCEPTIONS 0
#include <toml++/toml.h>

namespace gnathion {
namespace {

constexpr double kContactFadeMm = 0.4;
constexpr double kDeepestMm = 1.0;  // the body's distance is known this far out
constexpr const char* kWhat = "cannot read edits";

constexpr std::pair<const char*, Stroke::Kind> kKinds[] = {
    {"add", Stroke::Kind::kAdd}, {"remove", Stroke::Kind::kRemove}, {"smooth", Stroke::Kind::kSmooth}};

Result<std::vector<Vector3>> points_of(const toml::table& entry, const char* key, std::size_t least,
                                       const std::string& where) {
  const toml::array* list = entry[key].as_array();
  if (!list) return bad_input(kWhat, where, fmt::format("{} is missing: a list of [x, y, z] in mm", key));
  std::vector<Vector3> out;
  for (const toml::node& node : *list) {
    const toml::array* point = node.as_array();
    if (!point || point->size() != 3)
      return bad_input(kWhat, where, fmt::format("{}: a point is [x, y, z] in mm", key));
    Vector3 p;
    for (int d = 0; d < 3; ++d) {
      const auto value = point->get(static_cast<std::size_t>(d))->value<double>();
      if (!value || !std::isfinite(*value))
        return bad_input(kWhat, where, fmt::format("{}: not a number", key));
      p[d] = *value;
    }
    out.push_back(p);
  }
  if (out.size() < least)
    return bad_input(kWhat, where, fmt::format("{} has {} point(s), {} are needed", key, out.size(), least));
  return out;
}

Status only_keys(const toml::table& entry, std::initializer_list<const char*> known,
                 const std::string& where) {
  for (const auto& [key, node] : entry)
    if (std::none_of(known.begin(), known.end(), [&](const char* k) { return key.str() == k; }))
      return bad_input(kWhat, where, fmt::format("{}: no such key", std::string_view(key.str())));
  return {};
}

Result<double> number_of(const toml::table& entry, const char* key, double fallback, double low, double high,
                         const std::string& where) {
  if (!entry.contains(key)) return fallback;
  const auto value = entry[key].value<double>();
  if (!value || !(*value >= low && *value <= high))
    return bad_input(kWhat, where, fmt::format("{} is not a number from {} to {} mm", key, low, high));
  return *value;
}

Result<Stroke> stroke_of(const toml::table& entry, const std::string& where) {
  GNATHION_CHECK_OK(only_keys(entry, {"kind", "path_mm", "radius_mm", "depth_mm"}, where));
  Stroke stroke;
  const std::string kind = entry["kind"].value_or(std::string());
  const auto* known =
      std::find_if(std::begin(kKinds), std::end(kKinds), [&](const auto& k) { return kind == k.first; });
  if (known == std::end(kKinds)) return bad_input(kWhat, where, "kind is add, remove or smooth");
  stroke.kind = known->second;
  GNATHION_TRY(stroke.path_mm, points_of(entry, "path_mm", 1, where));
  GNATHION_TRY(stroke.radius_mm, number_of(entry, "radius_mm", stroke.radius_mm, 0.5, 10.0, where));
  GNATHION_TRY(stroke.depth_mm, number_of(entry, "depth_mm", stroke.depth_mm, 0.0, kDeepestMm, where));
  if (stroke.kind != Stroke::Kind::kSmooth && stroke.depth_mm > 0.5 * stroke.radius_mm)
    return bad_input(kWhat, where, "depth_mm is more than half of radius_mm: the surface would fold");
  return stroke;
}

/// The tables of [[design.NAME]], each with its name in errors.
Result<std::vector<std::pair<const toml::table*, std::string>>> entries_of(const toml::table& design,
                                                                           const char* name,
                                                                           const std::string& file) {
  std::vector<std::pair<const toml::table*, std::string>> out;
  if (!design.contains(name)) return out;
  const toml::array* list = design[name].as_array();
  if (!list)
    return bad_input(kWhat, file, fmt::format("design.{} is not a list: write [[design.{}]]", name, name));
  for (const toml::node& node : *list) {
    const std::string where = fmt::format("{}: design.{} {}", file, name, out.size() + 1);
    if (!node.as_table()) return bad_input(kWhat, where, "not a table");
    out.emplace_back(node.as_table(), where);
  }
  return out;
}

Result<std::vector<Region>> regions_of(const toml::table& design, const char* name, const std::string& file) {
  GNATHION_TRY(const auto entries, entries_of(design, name, file));
  std::vector<Region> out;
  for (const auto& [entry, where] : entries) {
    GNATHION_CHECK_OK(only_keys(*entry, {"outline_mm"}, where));
    Region region;
    GNATHION_TRY(region.outline_mm, points_of(*entry, "outline_mm", 3, where));
    out.push_back(std::move(region));
  }
  return out;
}

bool is_fdi(std::int64_t number) {
  return number >= 11 && number <= 48 && number % 10 >= 1 && number % 10 <= 8;
}

Status add_tooth(const toml::table& entry, const std::string& where, ToothCorrections& teeth) {
  GNATHION_CHECK_OK(only_keys(entry, {"fdi", "missing", "at_mm"}, where));
  const auto fdi = entry["fdi"].value<std::int64_t>();
  if (!fdi || !is_fdi(*fdi))
    return bad_input(kWhat, where, "fdi is not a permanent tooth's number (11 to 48)");
  const bool missing = entry["missing"].value_or(false);
  if (missing == entry.contains("at_mm"))
    return bad_input(kWhat, where, "give either missing = true or at_mm, a point on that tooth");
  const auto number = static_cast<std::uint8_t>(*fdi);
  if (missing) {
    teeth.missing.push_back(number);
    return {};
  }
  const toml::array* at = entry["at_mm"].as_array();
  if (!at || at->size() != 3) return bad_input(kWhat, where, "at_mm is [x, y, z] in mm");
  ToothCorrections::Label label{number, {}};
  for (int d = 0; d < 3; ++d) {
    const auto value = at->get(static_cast<std::size_t>(d))->value<double>();
    if (!value || !std::isfinite(*value)) return bad_input(kWhat, where, "at_mm is [x, y, z] in mm");
    label.at_mm[d] = *value;
  }
  teeth.labels.push_back(label);
  return {};
}

Status no_contradiction(const ToothCorrections& teeth, const std::string& where) {
  for (const auto& label : teeth.labels)
    if (std::find(teeth.missing.begin(), teeth.missing.end(), label.fdi) != teeth.missing.end())
      return bad_input(kWhat, where, fmt::format("tooth {} is missing and has a place", label.fdi));
  return {};
}

/// Teeth, margins and the label.
Status add_marks(const toml::table& design, const std::string& name, SplintEdits& edits) {
  GNATHION_TRY(const auto teeth, entries_of(design, "tooth", name));
  for (const auto& [entry, where] : teeth) GNATHION_CHECK_OK(add_tooth(*entry, where, edits.teeth));
  GNATHION_CHECK_OK(no_contradiction(edits.teeth, name + ": design.tooth"));
  GNATHION_TRY(const auto margins, entries_of(design, "margin", name));
  for (const auto& [entry, where] : margins) {
    GNATHION_CHECK_OK(only_keys(*entry, {"points_mm"}, where));
    MarginCurve margin;
    GNATHION_TRY(margin.points_mm, points_of(*entry, "points_mm", 2, where));
    edits.margins.push_back(std::move(margin));
  }
  if (!design.contains("label")) return {};
  const auto text = design["label"].value<std::string>();
  if (!text) return bad_input(kWhat, name + ": design.label", "not a text");
  if (const Status fits = check_label(*text); !fits)
    return bad_input(kWhat, name + ": design.label", fits.error().why);
  edits.label = *text;
  return {};
}

double distance_to_path_mm(const std::vector<Vector3>& path, const Vector3& p) {
  double least = (p - path.front()).norm();
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    const Vector3 along = path[i + 1] - path[i];
    const double t = std::clamp((p - path[i]).dot(along) / std::max(1e-12, along.squaredNorm()), 0.0, 1.0);
    least = std::min(least, (p - path[i] - t * along).norm());
  }
  return least;
}

/// Signed distance to a polygon, negative inside (crossings).
double polygon_mm(const std::vector<Eigen::Vector2d>& outline, const Eigen::Vector2d& p) {
  double least = 1e300;
  bool inside = false;
  for (std::size_t i = 0, j = outline.size() - 1; i < outline.size(); j = i++) {
    const Eigen::Vector2d &a = outline[j], &b = outline[i], along = b - a;
    const double t = std::clamp((p - a).dot(along) / std::max(1e-12, along.squaredNorm()), 0.0, 1.0);
    least = std::min(least, (p - a - t * along).norm());
    if ((a.y() > p.y()) != (b.y() > p.y()) &&
        p.x() < a.x() + (p.y() - a.y()) / (b.y() - a.y()) * (b.x() - a.x()))
      inside = !inside;
  }
  return inside ? -least : least;
}

double faded(double t) {
  t = std::clamp(1.0 - t, 0.0, 1.0);
  return t * t * (3.0 - 2.0 * t);
}

nlohmann::json points_json(const std::vector<Vector3>& points) {
  nlohmann::json out = nlohmann::json::array();
  for (const Vector3& p : points) out.push_back({p.x(), p.y(), p.z()});
  return out;
}

}  // namespace

Result<SplintEdits> parse_edits(std::string_view text, const std::string& name) {
  const toml::parse_result parsed = toml::parse(text, name);
  if (!parsed)
    return bad_input(kWhat, fmt::format("{}:{}", name, parsed.error().source().begin.line),
                     std::string(parsed.error().description()));
  SplintEdits edits;
  const toml::table* design = parsed.table()["design"].as_table();
  if (!design) return edits;
  GNATHION_TRY(const auto strokes, entries_of(*design, "stroke", name));
  for (const auto& [entry, where] : strokes) {
    GNATHION_TRY(Stroke stroke, stroke_of(*entry, where));
    edits.strokes.push_back(std::move(stroke));
  }
  GNATHION_TRY(edits.cutouts, regions_of(*design, "cutout", name));
  GNATHION_TRY(edits.contacts, regions_of(*design, "contact", name));
  GNATHION_CHECK_OK(add_marks(*design, name, edits));
  return edits;
}

Status check_label(const std::string& text) {
  const auto known = [](char c) {
    return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') ||
           std::string_view(" .-_#/:+").find(c) != std::string_view::npos;
  };
  if (text.empty() || text.size() > 24 || !std::all_of(text.begin(), text.end(), known) ||
      text.find_first_not_of(' ') == std::string::npos)
    return fail(ErrorCode::kUsage, "cannot design", "label",
                "write 1 to 24 letters (A to Z), digits, spaces and . - _ # / : +");
  return {};
}

Status add_tooth_correction(ToothCorrections& teeth, const std::string& text) {
  const auto refuse = [&](const char* why) {
    return fail(ErrorCode::kUsage, "cannot design", "tooth " + text, why);
  };
  const std::size_t equals = text.find('=');
  if (equals == std::string::npos) return refuse("write 16=missing or 24=x,y,z");
  const std::string value = text.substr(equals + 1);
  const std::string at = value == "missing" ? "missing = true" : "at_mm = [" + value + "]";
  const toml::parse_result parsed = toml::parse("fdi = " + text.substr(0, equals) + "\n" + at);
  if (!parsed) return refuse("write 16=missing or 24=x,y,z");
  const Status added = add_tooth(parsed.table(), "tooth " + text, teeth);
  if (!added) return fail(ErrorCode::kUsage, "cannot design", added.error().where, added.error().why);
  const Status sound = no_contradiction(teeth, "tooth " + text);
  if (!sound) return fail(ErrorCode::kUsage, "cannot design", sound.error().where, sound.error().why);
  return {};
}

std::string marks_toml(const SplintEdits& edits) {
  const auto numbers = [](const Vector3& p) {
    return fmt::format("[{:.4f}, {:.4f}, {:.4f}]", p.x(), p.y(), p.z());
  };
  std::string out;
  if (!edits.label.empty()) out += fmt::format("[design]\nlabel = \"{}\"\n", edits.label);
  for (const std::uint8_t fdi : edits.teeth.missing)
    out += fmt::format("[[design.tooth]]\nfdi = {}\nmissing = true\n", fdi);
  for (const ToothCorrections::Label& label : edits.teeth.labels)
    out += fmt::format("[[design.tooth]]\nfdi = {}\nat_mm = {}\n", label.fdi, numbers(label.at_mm));
  for (const MarginCurve& margin : edits.margins) {
    std::string points;
    for (const Vector3& p : margin.points_mm) points += (points.empty() ? "" : ", ") + numbers(p);
    out += fmt::format("[[design.margin]]\npoints_mm = [{}]\n", points);
  }
  return out;
}

nlohmann::json edits_json(const SplintEdits& edits) {
  nlohmann::json strokes = nlohmann::json::array(), cutouts = strokes, contacts = strokes;
  for (const Stroke& s : edits.strokes)
    strokes.push_back({{"kind", kKinds[static_cast<std::size_t>(s.kind)].first},
                       {"path_mm", points_json(s.path_mm)},
                       {"radius_mm", s.radius_mm},
                       {"depth_mm", s.depth_mm}});
  for (const Region& r : edits.cutouts) cutouts.push_back({{"outline_mm", points_json(r.outline_mm)}});
  for (const Region& r : edits.contacts) contacts.push_back({{"outline_mm", points_json(r.outline_mm)}});
  nlohmann::json teeth = nlohmann::json::array(), margins = teeth;
  for (const std::uint8_t fdi : edits.teeth.missing) teeth.push_back({{"fdi", fdi}, {"missing", true}});
  for (const ToothCorrections::Label& label : edits.teeth.labels)
    teeth.push_back({{"fdi", label.fdi}, {"at_mm", {label.at_mm.x(), label.at_mm.y(), label.at_mm.z()}}});
  for (const MarginCurve& m : edits.margins) margins.push_back({{"points_mm", points_json(m.points_mm)}});
  return {{"stroke", strokes}, {"cutout", cutouts}, {"contact", contacts},
          {"tooth", teeth},    {"margin", margins}, {"label", edits.label}};
}

EditField::EditField(const SplintEdits& edits, const Rigid3& design_from_dental) : strokes_(edits.strokes) {
  for (Stroke& s : strokes_)
    for (Vector3& p : s.path_mm) p = design_from_dental * p;
  const auto flat = [&](const std::vector<Region>& regions) {
    std::vector<Outline> out;
    for (const Region& r : regions) {
      Outline outline;
      for (const Vector3& p : r.outline_mm) outline.push_back((design_from_dental * p).head<2>());
      out.push_back(std::move(outline));
    }
    return out;
  };
  cutouts_ = flat(edits.cutouts);
  contacts_ = flat(edits.contacts);
}

bool EditField::smooths() const {
  return std::any_of(strokes_.begin(), strokes_.end(),
                     [](const Stroke& s) { return s.kind == Stroke::Kind::kSmooth; });
}

double EditField::stroked(const Vector3& p, double body_mm, double smoothed_mm) const {
  double moved_mm = 0.0;  // by the strokes before: a smoothing stroke keeps what they did
  for (const Stroke& s : strokes_) {
    const double weight = faded(distance_to_path_mm(s.path_mm, p) / s.radius_mm);
    if (weight <= 0.0) continue;
    double by_mm = weight * s.depth_mm;
    if (s.kind == Stroke::Kind::kAdd) by_mm = -by_mm;
    if (s.kind == Stroke::Kind::kSmooth)
      by_mm = weight * std::clamp(smoothed_mm - body_mm, -s.depth_mm, s.depth_mm);
    if (s.kind == Stroke::Kind::kSmooth)
      body_mm += by_mm;
    else
      moved_mm += by_mm;
  }
  return body_mm + moved_mm;
}

double EditField::outside_mm(const std::vector<Outline>& outlines, const Vector3& p) {
  double least = 1e300;
  for (const Outline& outline : outlines) least = std::min(least, polygon_mm(outline, p.head<2>()));
  return least;
}

double EditField::cutout_mm(const Vector3& p) const {
  return outside_mm(cutouts_, p);
}

double EditField::without_contact(const Vector3& p) const {
  return std::clamp(outside_mm(contacts_, p) / kContactFadeMm, 0.0, 1.0);
}

}  // namespace gnathion
