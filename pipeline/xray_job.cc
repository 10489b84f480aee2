#include "pipeline/xray_job.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "anatomy/volume/iso_surface.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "core/time.h"
#include "pipeline/dental_motion.h"
#include "pipeline/nested_progress.h"
#include "rendering/drawing.h"
#include "rendering/grey_png.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

Result<XrayView> view_of(const std::string& name, const ArchFrame& arch) {
  const std::size_t comma = name.find(',');
  if (comma == std::string::npos) return named_view(name, arch);
  char* end = nullptr;
  const double turn = std::strtod(name.c_str(), &end);
  const bool turn_ok = end == name.c_str() + comma;
  const double tilt = std::strtod(name.c_str() + comma + 1, &end);
  if (!turn_ok || *end != '\0' || end == name.c_str() + comma + 1 || !std::isfinite(turn) ||
      !(std::abs(tilt) <= 90.0))
    return fail(ErrorCode::kUsage, "no such view", name, "TURN,TILT are two angles in degrees");
  return turned_view(turn, tilt, arch);
}

/// Room about a joint in which voxels are parted: the film's field, and as much above and below.
Box room_about(const Vector3& centre_in_cbct, double field_mm) {
  Box box;
  box.extend(centre_in_cbct - Vector3::Constant(0.6 * field_mm));
  box.extend(centre_in_cbct + Vector3::Constant(0.6 * field_mm));
  return box;
}

std::vector<Vector3> in_volume(const Rigid3& cbct_from_mesh, const TriangleMesh& mesh) {
  std::vector<Vector3> out;
  for (const Vector3& v : mesh.vertices_mm) out.push_back(cbct_from_mesh * v);
  return out;
}

/// A joint whose condyle and fossa hang together at the bone's level may part at a higher one.
Result<VoxelMask> parted(const Volume& volume, double level, const std::vector<Vector3>& condyle,
                         const std::vector<Vector3>& fossa, const Box& box, double* used) {
  Result<VoxelMask> mask = bad_input("cannot part the mandible", "joint", "no bone");
  for (const double factor : {1.0, 1.1, 1.25, 1.45, 1.7}) {
    *used = level * factor;
    mask = mandible_from_bone(volume, *used, condyle, fossa, box);
    if (mask) break;
  }
  return mask;
}

json vector_json(const Vector3& v) {
  return {v.x(), v.y(), v.z()};
}

std::string file_name(const XraySeries& s, std::size_t step) {
  std::string view = s.view.name;
  std::replace(view.begin(), view.end(), ' ', '_');
  return fmt::format("{}_{}_{:03}.png", view, side_name(s.side), step);
}

}  // namespace

std::vector<XrayStep> xray_steps(const std::optional<Motion<Dental>>& therapeutic,
                                 const std::optional<JawMotion>& recording, int steps,
                                 const Vector3& about_mm) {
  std::vector<XrayStep> out;
  const int last = std::max(1, steps - 1);
  if (therapeutic) {
    const Vector3 turn = log_so3(therapeutic->rigid.rotation);
    const Vector3 shift = therapeutic->rigid * about_mm - about_mm;
    for (int i = 0; i < steps; ++i) {
      const double part = static_cast<double>(i) / last;
      const Matrix3 rotation = exp_so3(part * turn);
      out.push_back({i == 0      ? "MI"
                     : i == last ? "T_th"
                                 : fmt::format("{:.0f} % of T_th", 100.0 * part),
                     {rotation, about_mm - rotation * about_mm + part * shift}});
    }
    out.back().motion = steps > 1 ? therapeutic->rigid : out.back().motion;
    return out;
  }
  std::vector<const JawMotionRow*> rows;
  for (const JawMotionRow& row : recording->rows)
    if (row.valid) rows.push_back(&row);
  if (rows.empty()) return out;
  const double first_s = rows.front()->time_s, whole_s = rows.back()->time_s - first_s;
  for (int i = 0; i < steps; ++i) {
    const double wanted = first_s + whole_s * i / last;
    const auto* nearest = *std::min_element(rows.begin(), rows.end(), [&](const auto* a, const auto* b) {
      return std::abs(a->time_s - wanted) < std::abs(b->time_s - wanted);
    });
    out.push_back({fmt::format("{:.2f} s", nearest->time_s), nearest->motion});
  }
  return out;
}

Result<std::vector<MovingJoint>> moving_joints(const RegisteredVolume& registered, const Joints& joints,
                                               const CbctOptions& options, double field_mm,
                                               std::vector<std::string>* notes) {
  const Volume& volume = registered.file.volume;
  const double level = options.bone_level ? *options.bone_level : tissue_levels(volume).bone;
  const Rigid3 cbct_from_scanned = registered.cbct_from_dental.rigid * joints.scanned_from_mi.rigid;
  std::optional<Volume> labels;
  if (!options.labels.empty() && !options.condyle_labels.empty()) {
    SilentProgress silent;
    GNATHION_TRY(VolumeFile file, read_volume(options.labels, options.read, silent));
    labels = std::move(file.volume);
  }
  std::vector<MovingJoint> out;
  std::optional<Error> why;
  for (const auto* joint : {&joints.left, &joints.right}) {
    if (!*joint) continue;
    MovingJoint moving;
    moving.side = (*joint)->side;
    moving.centre_mm = (*joint)->centre_mm();
    const Box box = room_about(cbct_from_scanned * moving.centre_mm, field_mm);
    double used = level;
    Result<VoxelMask> mask =
        labels ? mandible_from_labels(volume, *labels, options.condyle_labels, box)
               : parted(volume, level, in_volume(cbct_from_scanned, (*joint)->condyle),
                        in_volume(registered.cbct_from_dental.rigid, (*joint)->fossa), box, &used);
    if (!mask) {
      notes->push_back(fmt::format("{} joint: {}", side_name(moving.side), mask.error().line()));
      if (!why) why = mask.error();
      continue;
    }
    if (used > level)
      notes->push_back(
          fmt::format("{} joint: condyle and fossa part only above {:.0f}: the condyle's rim below "
                      "that stays with the skull",
                      side_name(moving.side), used));
    moving.mandible = std::move(*mask);
    out.push_back(std::move(moving));
  }
  if (out.empty()) {
    if (!why) return bad_input("cannot make X-rays", "joints", "none was found");
    return tl::unexpected<Error>(*why);
  }
  return out;
}

XrayOptions scaled_to(const Volume& volume, XrayOptions options, std::vector<std::string>* notes) {
  constexpr double kHuMargin = 200.0;  // scatter and beam hardening shift CBCT values by as much
  const TissueLevels levels = tissue_levels(volume);
  const bool hu =
      std::abs(levels.soft) < kHuMargin && (!levels.air || std::abs(*levels.air + 1000.0) < kHuMargin);
  if (hu) return options;
  options.soft_tissue = levels.soft;
  if (!levels.air) {
    notes->push_back(fmt::format(
        "values are no Hounsfield units (soft tissue at {:.0f}) and nothing in the volume is air: bone's "
        "densities in the X-rays are not to scale",
        levels.soft));
    options.water_value = levels.soft;
    options.air_value = levels.soft - 1000.0;
    return options;
  }
  notes->push_back(
      fmt::format("values are no Hounsfield units: attenuation scaled from air at {:.0f} and soft "
                  "tissue at {:.0f}",
                  *levels.air, levels.soft));
  options.air_value = *levels.air;
  options.water_value = levels.soft;
  return options;
}

Result<XrayOutcome> make_xrays(const XrayJob& job, Progress& progress) {
  const PatientFiles& files = job.files;
  if (job.steps < 1 || job.steps > 2000)
    return fail(ErrorCode::kUsage, "cannot make X-rays", "--steps", "1 to 2000");
  if (!job.therapeutic && files.motion.empty())
    return fail(ErrorCode::kUsage, "cannot make X-rays", "--transform, --motion", "one of them is needed");
  std::error_code ec;
  if (fs::is_directory(files.cbct, ec) && holds_joint_meshes(files.cbct))
    return fail(ErrorCode::kUsage, "cannot make X-rays", files.cbct.string(),
                "meshes have no densities: give the volume");
  GNATHION_TRY(const TriangleMesh maxilla, read_jaw(files.maxilla));
  GNATHION_TRY(const TriangleMesh mandible, read_jaw(files.mandible));
  GNATHION_TRY(const ArchFrame arch, find_arch(maxilla, mandible));
  std::vector<XrayView> views;
  for (const std::string& name : job.views) {
    GNATHION_TRY(XrayView view, view_of(name, arch));
    views.push_back(std::move(view));
  }
  std::optional<JawMotion> recording;
  if (!job.therapeutic) {
    GNATHION_TRY(recording, read_dental_motion(files.motion, files.calibration));
  }
  GNATHION_TRY(const CbctOptions options, cbct_options_of(files));
  XrayOutcome out;
  std::optional<RegisteredVolume> registered;
  std::optional<Joints> joints;
  {
    NestedProgress finding(progress, "reading the volume, finding the joints", 0.6);
    GNATHION_TRY(registered, registered_volume(files.cbct, maxilla, mandible, options, finding));
    GNATHION_TRY(joints, joints_in_volume(*registered, maxilla, mandible, options, finding));
  }
  out.notes = joints->warnings;
  for (const std::string& w : registered->file.info.warnings) out.notes.push_back(w);

  progress.begin_step("films of the resting head", 0.2);
  Stopwatch watch;
  GNATHION_TRY(const std::vector<MovingJoint> moving,
               moving_joints(*registered, *joints, options, job.options.field_mm, &out.notes));
  const XrayOptions film = scaled_to(registered->file.volume, job.options, &out.notes);
  std::vector<JointXray> xrays;
  Vector3 middle = Vector3::Zero();
  for (const MovingJoint& joint : moving) {
    middle += joint.centre_mm / static_cast<double>(moving.size());
    for (const XrayView& view : views) {
      GNATHION_TRY(JointXray xray,
                   JointXray::create(registered->file.volume, registered->cbct_from_dental, joint.mandible,
                                     joint.centre_mm, view, film, joints->scanned_from_mi));
      out.series.push_back({joint.side, view, {}, {}});
      out.series.back().window = job.window ? *job.window : window_of(xray.film({}));
      xrays.push_back(std::move(xray));
      progress.update(static_cast<double>(xrays.size()) / static_cast<double>(moving.size() * views.size()));
    }
  }
  out.preparing_s = watch.seconds();

  progress.begin_step("films of each step", 0.2);
  watch.restart();
  out.steps = xray_steps(job.therapeutic, recording, job.steps, middle);
  for (std::size_t i = 0; i < out.steps.size(); ++i) {
    for (std::size_t k = 0; k < xrays.size(); ++k)
      out.series[k].films.push_back(xrays[k].film(Motion<Dental>(out.steps[i].motion)));
    progress.update(static_cast<double>(i + 1) / static_cast<double>(out.steps.size()));
  }
  out.films_s = watch.seconds();
  return out;
}

json xray_json(const XrayOutcome& outcome, const XrayJob& job) {
  json steps = json::array(), series = json::array();
  for (const XrayStep& s : outcome.steps) {
    const Matrix4 m = s.motion.matrix();
    steps.push_back({{"name", s.name}, {"matrix", matrix_json(m)}});
  }
  for (const XraySeries& s : outcome.series) {
    json files = json::array();
    for (std::size_t i = 0; i < s.films.size(); ++i) files.push_back(file_name(s, i));
    series.push_back({{"side", side_name(s.side)},
                      {"view", s.view.name},
                      {"beam", vector_json(s.view.beam)},
                      {"right", vector_json(s.view.right)},
                      {"up", vector_json(s.view.up)},
                      {"window", {{"low", s.window.low}, {"high", s.window.high}}},
                      {"files", files}});
  }
  const double films = static_cast<double>(outcome.steps.size() * outcome.series.size());
  return {{"kind", "xray"},
          {"size_px", job.options.size_px},
          {"field_mm", job.options.field_mm},
          {"depth_mm", job.options.depth_mm},
          {"source_mm", job.options.source_mm},
          {"water_per_mm", job.options.water_per_mm},
          {"values", "line integral of attenuation, shown from window.low (black) to window.high (white)"},
          {"steps", steps},
          {"series", series},
          {"timing_s",
           {{"preparing", outcome.preparing_s},
            {"films", outcome.films_s},
            {"per_film", films > 0 ? outcome.films_s / films : 0.0}}},
          {"notes", outcome.notes}};
}

Status write_xrays(const XrayOutcome& outcome, const XrayJob& job, const fs::path& folder) {
  constexpr double kFilm = 150, kGap = 6, kLeft = 66, kTop = 40;
  const std::size_t most = 8;  // columns of the sheet
  const std::size_t stride = (outcome.steps.size() + most - 1) / most;
  std::vector<std::size_t> shown;
  for (std::size_t i = 0; i < outcome.steps.size(); i += stride) shown.push_back(i);
  if (shown.size() < most && shown.back() + 1 != outcome.steps.size())
    shown.push_back(outcome.steps.size() - 1);
  Drawing sheet(kLeft + static_cast<double>(shown.size()) * (kFilm + kGap) + 4,
                kTop + static_cast<double>(outcome.series.size()) * (kFilm + kGap) + 20);
  sheet.rectangle({0, 0}, {sheet.width_pt(), sheet.height_pt()}, filled({1, 1, 1}));
  TextStyle head, small;
  head.bold = true;
  small.size_pt = 8;
  sheet.text({6, 14}, "Virtual X-rays of the joints", head);
  for (std::size_t c = 0; c < shown.size(); ++c)
    sheet.text({kLeft + static_cast<double>(c) * (kFilm + kGap), kTop - 6}, outcome.steps[shown[c]].name,
               small);
  double y = kTop;
  for (const XraySeries& s : outcome.series) {
    sheet.text({6, y + 20}, s.view.name, small);
    sheet.text({6, y + 32}, side_name(s.side), small);
    for (std::size_t i = 0; i < s.films.size(); ++i) {
      GNATHION_TRY(const std::string png, png_bytes(windowed(s.films[i], s.window.low, s.window.high)));
      GNATHION_CHECK_OK(write_file(folder / file_name(s, i), png));
      const auto column = std::find(shown.begin(), shown.end(), i);
      if (column != shown.end())
        sheet.image({kLeft + static_cast<double>(column - shown.begin()) * (kFilm + kGap), y}, {kFilm, kFilm},
                    png);
    }
    y += kFilm + kGap;
  }
  const double ten = 10.0 / job.options.field_mm * kFilm;
  sheet.line({kLeft, y + 8}, {kLeft + ten, y + 8}, stroked({0, 0, 0}, 1.5));
  sheet.text({kLeft + ten + 5, y + 11},
             "10 mm; lateral: the face looks right; else the patient's left is on the right", small);
  GNATHION_TRY(const std::string bytes, png_bytes(sheet, 1.7));
  GNATHION_CHECK_OK(write_file(folder / "sheet.png", bytes));
  return write_json(folder / "xray.json", xray_json(outcome, job));
}

}  // namespace gnathion
