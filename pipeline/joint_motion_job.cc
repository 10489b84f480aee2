#include "pipeline/joint_motion_job.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <mutex>
#include <nlohmann/json.hpp>

#include "core/file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;

JointRow row_of(const JointQuery& joint, const Rigid3& motion, double time_s) {
  const Joint& j = joint.joint();
  JointRow row;
  row.time_s = time_s;
  row.space = joint.at(motion);
  row.lateral_pole_mm = motion * j.lateral_pole_mm;
  row.medial_pole_mm = motion * j.medial_pole_mm;
  row.centre_mm = motion * j.centre_mm();
  return row;
}

std::vector<const JawMotionRow*> valid_rows(const Patient& patient, std::size_t* invalid) {
  std::vector<const JawMotionRow*> rows;
  if (!patient.motion) return rows;
  for (const JawMotionRow& row : patient.motion->rows) {
    if (row.valid)
      rows.push_back(&row);
    else
      ++*invalid;
  }
  return rows;
}

void follow(const JointQuery& joint, const std::vector<const JawMotionRow*>& rows, Progress& progress,
            JointMotion* out) {
  out->rows.resize(rows.size());
  std::mutex mutex;
  std::size_t done = 0;
  tbb::parallel_for(std::size_t{0}, rows.size(), [&](std::size_t i) {
    out->rows[i] = row_of(joint, rows[i]->motion, rows[i]->time_s);
    const std::lock_guard lock(mutex);
    progress.update(static_cast<double>(++done) / static_cast<double>(rows.size()));
  });
}

json point(const Vector3& p) {
  return {p.x(), p.y(), p.z()};
}

/// In the arch's directions: left, back, up from MI.
json path_json(const Vector3& moved, const Vector3& mi, const ArchFrame& arch) {
  return point(arch.arch_from_dental.rotation * (moved - mi));
}

json row_json(const JointRow& row, const JointRow& mi, const ArchFrame& arch) {
  return {{"min_mm", row.space.min_mm},
          {"condyle_mm", point(row.space.condyle_mm)},
          {"fossa_mm", point(row.space.fossa_mm)},
          {"lateral_pole_left_back_up_mm", path_json(row.lateral_pole_mm, mi.lateral_pole_mm, arch)},
          {"medial_pole_left_back_up_mm", path_json(row.medial_pole_mm, mi.medial_pole_mm, arch)},
          {"centre_left_back_up_mm", path_json(row.centre_mm, mi.centre_mm, arch)}};
}

std::string csv_of(const JointMotions& motions) {
  std::string csv =
      "side,position,time_s,min_mm,condyle_x_mm,condyle_y_mm,condyle_z_mm,fossa_x_mm,fossa_y_mm,fossa_z_mm,"
      "lateral_pole_x_mm,lateral_pole_y_mm,lateral_pole_z_mm,medial_pole_x_mm,medial_pole_y_mm,medial_pole_z_"
      "mm\n";
  const auto add = [&](const JointMotion& joint, const char* position, const JointRow& r, bool timed) {
    csv += fmt::format("{},{},{}", side_name(joint.side), position,
                       timed ? fmt::format("{:.6f}", r.time_s) : "");
    csv += fmt::format(",{:.5f}", r.space.min_mm);
    for (const Vector3& p : {r.space.condyle_mm, r.space.fossa_mm, r.lateral_pole_mm, r.medial_pole_mm})
      csv += fmt::format(",{:.4f},{:.4f},{:.4f}", p.x(), p.y(), p.z());
    csv += '\n';
  };
  for (const JointMotion& joint : motions.joints) {
    add(joint, "MI", joint.mi, false);
    if (joint.tp) add(joint, "TP", *joint.tp, false);
    for (const JointRow& r : joint.rows) add(joint, "recorded", r, true);
  }
  return csv;
}

}  // namespace

Result<JointMotions> follow_joints(const Patient& patient, const std::optional<Motion<Dental>>& therapeutic,
                                   Progress& progress) {
  const JointPair& pair = patient.checker.joints();
  if (pair.empty())
    return fail(ErrorCode::kUsage, "cannot follow joints", "--cbct",
                "neither volume nor meshes of them are given");
  if (!therapeutic && !patient.motion)
    return fail(ErrorCode::kUsage, "cannot follow joints", "--transform, --motion", "one of them is needed");
  JointMotions out;
  out.source = pair.known.source;
  out.notes = patient.notes;
  out.joint_space_mm = patient.checker.limits().joint_space_mm;
  const auto rows = valid_rows(patient, &out.invalid_rows);
  for (const auto* joint : {&pair.left, &pair.right}) {
    if (!*joint) continue;
    JointMotion motion;
    motion.side = (*joint)->joint().side;
    progress.begin_step(fmt::format("following the {} condyle", side_name(motion.side)), 0.25);
    motion.mi = row_of(**joint, Rigid3::identity(), 0.0);
    if (therapeutic) motion.tp = row_of(**joint, therapeutic->rigid, 0.0);
    follow(**joint, rows, progress, &motion);
    out.joints.push_back(std::move(motion));
  }
  return out;
}

json joint_motions_json(const JointMotions& motions, const ArchFrame& arch) {
  json j = {{"kind", "joint motion"}, {"unit", "mm"}, {"source", motions.source}, {"notes", motions.notes}};
  for (const JointMotion& joint : motions.joints) {
    json one = {{"mi", row_json(joint.mi, joint.mi, arch)},
                {"tp", joint.tp ? row_json(*joint.tp, joint.mi, arch) : json(nullptr)}};
    if (!joint.rows.empty()) {
      const auto narrowest =
          std::min_element(joint.rows.begin(), joint.rows.end(),
                           [](const auto& a, const auto& b) { return a.space.min_mm < b.space.min_mm; });
      const auto narrow = std::count_if(joint.rows.begin(), joint.rows.end(), [&](const JointRow& r) {
        return r.space.min_mm < motions.joint_space_mm;
      });
      json at = row_json(*narrowest, joint.mi, arch);
      at["time_s"] = narrowest->time_s;
      double path_mm = 0.0;
      for (const JointRow& r : joint.rows)
        path_mm = std::max(path_mm, (r.centre_mm - joint.mi.centre_mm).norm());
      one["recorded"] = {{"rows", joint.rows.size()},
                         {"rows_without_a_pose", motions.invalid_rows},
                         {"narrowest", at},
                         {"rows_narrower_than_limit", narrow},
                         {"limit_mm", motions.joint_space_mm},
                         {"farthest_centre_from_mi_mm", path_mm}};
    }
    j[side_name(joint.side)] = one;
  }
  return j;
}

std::string joint_motions_text(const JointMotions& motions) {
  std::string text;
  for (const JointMotion& joint : motions.joints) {
    text += fmt::format("{} joint: {:.2f} mm in MI", side_name(joint.side), joint.mi.space.min_mm);
    if (joint.tp) text += fmt::format(", {:.2f} mm in TP", joint.tp->space.min_mm);
    if (!joint.rows.empty()) {
      const auto narrowest =
          std::min_element(joint.rows.begin(), joint.rows.end(),
                           [](const auto& a, const auto& b) { return a.space.min_mm < b.space.min_mm; });
      text += fmt::format(", narrowest {:.2f} mm at {:.2f} s of {} recorded positions",
                          narrowest->space.min_mm, narrowest->time_s, joint.rows.size());
    }
    text += '\n';
  }
  for (const std::string& note : motions.notes) text += "  note: " + note + "\n";
  return text;
}

Status write_joint_motions(const JointMotions& motions, const Patient& patient,
                           const std::optional<Motion<Dental>>& therapeutic, const fs::path& folder) {
  GNATHION_CHECK_OK(write_json(folder / "joints.json", joint_motions_json(motions, patient.checker.arch())));
  GNATHION_CHECK_OK(write_file(folder / "joints.csv", csv_of(motions)));
  return draw_joint_motions(motions, patient, therapeutic, folder);
}

}  // namespace gnathion
