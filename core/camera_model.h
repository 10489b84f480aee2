// Pinhole camera with Brown–Conrady distortion, and the rig and bodies that tracking knows.
#pragma once

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/result.h"
#include "core/transform.h"

namespace gnathion {

/// x right, y down, z forward; pixel (0, 0) is the centre of the upper left pixel (OpenCV).
struct CameraModel {
  int width_px = 1280, height_px = 720;
  double fx_px = 1100, fy_px = 1100, cx_px = 639.5, cy_px = 359.5;
  double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;

  /// Pixel of a point in the camera's frame; nothing for z <= 0.
  std::optional<Eigen::Vector2d> project(const Vector3& p_camera_mm) const;
  /// Distorts normalised coordinates (x/z, y/z).
  Eigen::Vector2d distort(const Eigen::Vector2d& normalised) const;
  /// Normalised coordinates of a pixel (fixed-point iteration, then Newton; to 1e-12).
  Eigen::Vector2d undistorted(const Eigen::Vector2d& pixel) const;
};

struct RigCamera {
  std::string name;  ///< also the name of its stream in recordings
  CameraModel model;
  Rigid3 rig_from_camera;  ///< the rig's frame is the first camera's
  /// From the exposure of one row to that of the next; 0: global shutter; nothing: not known.
  std::optional<double> line_time_ns = std::nullopt;
  /// Standard deviation of (fx + fy)/2 from the calibration: what a later check for drift compares with.
  std::optional<double> focal_sigma_px = std::nullopt;
};

/// One square tag on a body; corners in the order of libapriltag: as the detector returns them for an
/// upright tag seen from the front: lower left, lower right, upper right, upper left.
struct BodyTag {
  int id = 0;
  std::array<Vector3, 4> corners_in_body_mm;
};

/// A rigid body with tags: the bow or the head frame.
struct TaggedBody {
  std::string name;  ///< "bow", "head_frame"
  std::string family = "tag36h11";
  std::vector<BodyTag> tags;
  std::optional<Vector3> up =
      std::nullopt;  ///< the patient's cranial direction when it is worn, body's frame
};

struct Rig {
  std::vector<RigCamera> cameras;
  TaggedBody bow, head_frame;
};

/// RIG.toml (docs/formats.md): [[camera]] and the paths of bow and head-frame files beside it.
Result<Rig> read_rig(const std::filesystem::path& path);
/// The [[camera]] entries of a RIG.toml alone; the bodies need not be there.
Result<std::vector<RigCamera>> read_rig_cameras(const std::filesystem::path& path);
/// One [[camera]] entry of a RIG.toml.
std::string rig_camera_toml(const RigCamera& camera);
/// bow.toml: name, family and [[tag]] with id and corners_mm.
Result<TaggedBody> read_body(const std::filesystem::path& path);
/// The same, written; `comment` stands on the first lines.
Status write_body(const std::filesystem::path& path, const TaggedBody& body, const std::string& comment = {});
/// Writes RIG.toml, and bow.toml and head_frame.toml beside it.
Status write_rig(const std::filesystem::path& path, const Rig& rig);

}  // namespace gnathion
