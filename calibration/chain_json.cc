#include "calibration/chain_json.h"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/transform_io.h"

namespace gnathion {
namespace {

using nlohmann::json;

constexpr std::array<const char*, kChainStates> kStateNames = {"bow_from_dental", "bow_from_face",
                                                               "bow_from_face_tp", "face_mi_from_face_tp"};

double number_or(const json& j, const char* key, double fallback) {
  return j.contains(key) && j[key].is_number() ? j[key].get<double>() : fallback;
}

Result<ChainPose> pose_from_json(const json& j, const std::string& key, const std::string& where) {
  const auto bad = [&](const std::string& why) {
    return bad_input("cannot read chain", where, key + ": " + why);
  };
  if (!j.contains(key)) return bad("missing");
  const json& p = j[key];
  if (!p.is_object() || !p.contains("matrix") || !p.contains("covariance")) {
    return bad("an object with matrix and covariance is expected");
  }
  GNATHION_TRY(const Matrix4 matrix, matrix_from_json(p["matrix"], where + ": " + key));
  const RigidityDeviation deviation = rigidity_deviation(matrix);
  if (!deviation.is_rigid()) return bad("the matrix is not a rigid motion");
  ChainPose pose;
  pose.value = nearest_rigid(matrix);
  GNATHION_TRY(pose.covariance, covariance_from_json(p["covariance"], where + ": " + key));
  pose.rms_mm = number_or(p, "rms_mm", 0.0);
  pose.held_out_mm = number_or(p, "held_out_mm", 0.0);
  pose.condition = number_or(p, "condition", 0.0);
  if (p.contains("weak") && p["weak"].is_array()) {
    for (const json& w : p["weak"]) {
      if (w.is_string()) pose.weak.push_back(w.get<std::string>());
    }
  }
  return pose;
}

/// The joint covariance; without it the poses are taken as independent.
Status read_joint(const json& j, const std::string& where, Chain& chain) {
  const std::array<const ChainPose*, kChainStates> poses = {
      &chain.bow_from_dental, &chain.bow_from_face, &chain.bow_from_face_tp, &chain.face_mi_from_face_tp};
  for (int k = 0; k < kChainStates; ++k) {
    chain.joint.block<6, 6>(6 * k, 6 * k) = poses[static_cast<std::size_t>(k)]->covariance;
  }
  if (!j.contains("joint")) return {};
  const auto bad = [&](const std::string& why) {
    return bad_input("cannot read chain", where, "joint: " + why);
  };
  if (!j["joint"].is_object()) return bad("an object is expected");
  const json& joint = j["joint"];
  if (!joint.contains("poses") || joint["poses"] != json(kStateNames)) return bad("poses in another order");
  const auto n = static_cast<std::size_t>(chain.joint.rows());
  if (!joint.contains("covariance") || !joint["covariance"].is_array() || joint["covariance"].size() != n) {
    return bad("24 rows of covariance are expected");
  }
  for (std::size_t r = 0; r < n; ++r) {
    const json& row = joint["covariance"][r];
    if (!row.is_array() || row.size() != n) return bad("24 numbers in each row are expected");
    for (std::size_t c = 0; c < n; ++c) {
      if (!row[c].is_number() || !std::isfinite(row[c].get<double>())) return bad("not a finite number");
      chain.joint(static_cast<long>(r), static_cast<long>(c)) = row[c].get<double>();
    }
  }
  return {};
}

json tracked_json(const TrackedAgreement& a) {
  json j = {
      {"therapeutic_mm", a.therapeutic_mm}, {"therapeutic_deg", a.therapeutic_deg}, {"p_value", a.p_value}};
  if (a.head_from_bow_mm)
    j["head_from_bow_mi"] = {
        {"mm", *a.head_from_bow_mm}, {"deg", a.head_from_bow_deg}, {"p_value", a.head_from_bow_p_value}};
  return j;
}

}  // namespace

json pose_json(const ChainPose& pose) {
  json j = {{"matrix", matrix_json(pose.value.matrix())},
            {"covariance", covariance_json(pose.covariance)},
            {"rms_mm", pose.rms_mm},
            {"held_out_mm", pose.held_out_mm},
            {"condition", pose.condition},
            {"weak", json::array()}};
  for (const std::string& w : pose.weak) j["weak"].push_back(w);
  return j;
}

json chain_json(const Chain& chain) {
  json j = {{"kind", "chain"},
            {"unit", "mm"},
            {"bow_from_dental", pose_json(chain.bow_from_dental)},
            {"warnings", chain.warnings},
            {"missing", chain.missing}};
  if (!chain.has_faces) return j;
  j["bow_from_face"] = pose_json(chain.bow_from_face);
  j["bow_from_face_tp"] = pose_json(chain.bow_from_face_tp);
  j["face_mi_from_face_tp"] = pose_json(chain.face_mi_from_face_tp);
  j["dental_from_face"] = pose_json(chain.dental_from_face);
  j["bow_motion"] = pose_json(chain.bow_motion);
  json rows = json::array();
  for (long r = 0; r < chain.joint.rows(); ++r) {
    json row = json::array();
    for (long c = 0; c < chain.joint.cols(); ++c) row.push_back(chain.joint(r, c));
    rows.push_back(std::move(row));
  }
  const auto quality = [](const FaceScanQuality& q) {
    return json{{"deviation_mm", q.deviation_mm}, {"t_f_at_teeth_mm", q.at_teeth_mm}};
  };
  j["face_scans"] = {{"mi", quality(chain.face_mi)},
                     {"tp", quality(chain.face_tp)},
                     {"t_f_at_teeth_limit_mm", kLargestFaceScanError_mm}};
  j["joint"] = {{"poses", kStateNames}, {"covariance", std::move(rows)}};
  if (chain.tracked) j["tracked"] = tracked_json(*chain.tracked);
  return j;
}

Result<Chain> chain_from_json(const json& j, const std::string& where) {
  if (!j.is_object()) return bad_input("cannot read chain", where, "an object is expected");
  if (j.contains("kind") && j["kind"] != "chain")
    return bad_input("cannot read chain", where, "another kind of file");
  if (j.contains("unit") && j["unit"] != "mm") return bad_input("cannot read chain", where, "unit is not mm");
  Chain chain;
  GNATHION_TRY(chain.bow_from_dental, pose_from_json(j, "bow_from_dental", where));
  if (j.contains("warnings") && j["warnings"].is_array())
    for (const json& w : j["warnings"])
      if (w.is_string()) chain.warnings.push_back(w.get<std::string>());
  chain.has_faces = j.contains("bow_from_face");
  if (!chain.has_faces) {
    chain.joint.block<6, 6>(0, 0) = chain.bow_from_dental.covariance;
    return chain;
  }
  GNATHION_TRY(chain.bow_from_face, pose_from_json(j, "bow_from_face", where));
  GNATHION_TRY(chain.bow_from_face_tp, pose_from_json(j, "bow_from_face_tp", where));
  GNATHION_TRY(chain.face_mi_from_face_tp, pose_from_json(j, "face_mi_from_face_tp", where));
  GNATHION_TRY(chain.dental_from_face, pose_from_json(j, "dental_from_face", where));
  GNATHION_TRY(chain.bow_motion, pose_from_json(j, "bow_motion", where));
  GNATHION_CHECK_OK(read_joint(j, where, chain));
  for (const auto& [key, quality] : {std::pair{"mi", &chain.face_mi}, std::pair{"tp", &chain.face_tp}}) {
    if (!j.contains("face_scans") || !j["face_scans"].is_object() || !j["face_scans"].contains(key)) continue;
    quality->deviation_mm = number_or(j["face_scans"][key], "deviation_mm", 0.0);
    quality->at_teeth_mm = number_or(j["face_scans"][key], "t_f_at_teeth_mm", 0.0);
  }
  return chain;
}

}  // namespace gnathion
