// Files of a camera calibration: JSON, RIG.toml, picture.
#include <fmt/format.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "pipeline/camera_calibration_job.h"
#include "rendering/drawing.h"

namespace gnathion {
namespace {

using nlohmann::json;

json matrix_json(const Eigen::MatrixXd& m) {
  json rows = json::array();
  for (Eigen::Index r = 0; r < m.rows(); ++r) {
    json row = json::array();
    for (Eigen::Index c = 0; c < m.cols(); ++c) row.push_back(m(r, c));
    rows.push_back(row);
  }
  return rows;
}

json view_json(const ViewResult& v) {
  json residuals = json::array();
  for (const Eigen::Vector2d& r : v.residuals_px) residuals.push_back({r.x(), r.y()});
  return {{"name", v.name},           {"corners", v.corners},
          {"rms_px", v.rms_px},       {"held_out_px", v.held_out_px},
          {"tilt_deg", v.tilt_deg},   {"camera_from_board", matrix_json(v.camera_from_board.matrix())},
          {"residuals_px", residuals}};
}

json camera_json(const RigCameraResult& r) {
  const CameraCalibration& c = r.camera;
  const Vector9 k = intrinsics_of(c.model);
  json value, sigma, views = json::array();
  for (int i = 0; i < kIntrinsics; ++i) {
    value[intrinsic_names()[static_cast<std::size_t>(i)]] = k[i];
    sigma[intrinsic_names()[static_cast<std::size_t>(i)]] = c.sigma(i);
  }
  for (const ViewResult& v : c.views) views.push_back(view_json(v));
  json counts = json::array();
  for (int row = 0; row < c.coverage.rows; ++row) {
    json line = json::array();
    for (int col = 0; col < c.coverage.columns; ++col)
      line.push_back(c.coverage.counts[static_cast<std::size_t>(row * c.coverage.columns + col)]);
    counts.push_back(line);
  }
  return {{"name", r.name},
          {"width_px", c.model.width_px},
          {"height_px", c.model.height_px},
          {"value", value},
          {"sigma", sigma},
          {"parameters", intrinsic_names()},
          {"covariance", matrix_json(c.covariance)},
          {"focal_length",
           {{"value_px", 0.5 * (k[0] + k[1])},
            {"sigma_px", c.focal_sigma_px()},
            {"drift_share", c.focal_drift_share}}},
          {"rms_px", c.rms_px},
          {"held_out_px", c.held_out_px},
          {"noise_scale", c.noise_scale},
          {"extra_noise_px", c.extra_noise_px},
          {"board_sag_mm", c.bend.sag_mm},
          {"board_sag_sigma_mm", c.bend.sigma_mm},
          {"coverage",
           {{"counts", counts},
            {"covered_share", c.coverage.covered_share},
            {"radius_share", c.coverage.radius_share},
            {"thin", c.coverage.thin}}},
          {"views", views},
          {"dropped", c.dropped},
          {"warnings", c.warnings}};
}

constexpr double kWidthPt = 420, kMarginPt = 16;
constexpr double kArrow = 100;  // residuals are drawn this many times as long

std::shared_ptr<Drawing> camera_drawing(const RigCameraResult& r) {
  const CameraCalibration& c = r.camera;
  const double scale = kWidthPt / c.model.width_px, height = scale * c.model.height_px;
  auto d = std::make_shared<Drawing>(kWidthPt + 2 * kMarginPt, height + 64);
  d->rectangle({0, 0}, {d->width_pt(), d->height_pt()}, filled({1, 1, 1}));
  d->text({kMarginPt, 18},
          fmt::format("{}: {} views, RMS {:.3f} px, held out {:.3f} px", r.name, c.views.size(), c.rms_px,
                      c.held_out_px),
          {11, {0.11, 0.14, 0.19}, Anchor::kStart, true, 0});
  const Point2 origin(kMarginPt, 28);
  const double cw = kWidthPt / c.coverage.columns, ch = height / c.coverage.rows;
  for (int row = 0; row < c.coverage.rows; ++row)
    for (int col = 0; col < c.coverage.columns; ++col) {
      const int n = c.coverage.counts[static_cast<std::size_t>(row * c.coverage.columns + col)];
      const double share = std::min(1.0, n / 40.0);
      const Color color = n == 0 ? Color{1.0, 0.85, 0.80}
                                 : Color{0.97 - 0.27 * share, 0.98 - 0.12 * share, 1.0 - 0.10 * share};
      d->rectangle(origin + Point2(col * cw, row * ch), {cw, ch}, filled(color));
    }
  for (const ViewResult& v : c.views)
    for (std::size_t i = 0; i < v.residuals_px.size(); ++i) {
      if (!v.residuals_px[i].allFinite()) continue;
      const Point2 at = origin + scale * (v.corners_px[i] + Eigen::Vector2d(0.5, 0.5));
      d->circle(at, 0.7, filled({0.1, 0.2, 0.5}));
      d->line(at, at + scale * kArrow * v.residuals_px[i], stroked({0.8, 0.2, 0.1}, 0.4));
    }
  d->rectangle(origin, {kWidthPt, height}, stroked({0.3, 0.3, 0.3}, 0.8));
  d->text(
      {kMarginPt, height + 42},
      fmt::format("corners of all views; residuals drawn {:.0f} times as long; red: no corner there", kArrow),
      {8, {0.3, 0.3, 0.3}, Anchor::kStart, false, 0});
  d->text({kMarginPt, height + 54},
          fmt::format("f = {:.2f} ± {:.2f} px, centre ({:.2f} ± {:.2f}, {:.2f} ± {:.2f}) px",
                      0.5 * (c.model.fx_px + c.model.fy_px), c.focal_sigma_px(), c.model.cx_px, c.sigma(2),
                      c.model.cy_px, c.sigma(3)),
          {8, {0.3, 0.3, 0.3}, Anchor::kStart, false, 0});
  return d;
}

}  // namespace

json camera_calibration_json(const CameraCalibrationJob& job, const CameraCalibrationOutput& out) {
  json missing = json::array();
  for (const NotFound& n : out.not_found)
    missing.push_back({{"camera", n.camera}, {"image", n.image}, {"reason", n.reason}});
  if (out.rig.cameras.size() == 1) {
    json j = camera_json(out.rig.cameras[0]);
    j["kind"] = "camera_calibration";
    j["board"] = job.board.text();
    j["not_found"] = missing;
    return j;
  }
  json cameras = json::array(), parameters = json::array();
  for (const RigCameraResult& r : out.rig.cameras) {
    json j = camera_json(r);
    j["rig_from_camera"] = {{"matrix", matrix_json(r.rig_from_camera.matrix())},
                            {"covariance", matrix_json(r.covariance)}};
    j["held_out_rig_px"] = r.held_out_rig_px;
    cameras.push_back(j);
    for (const std::string& name : intrinsic_names()) parameters.push_back(r.name + "." + name);
  }
  for (std::size_t c = 1; c < out.rig.cameras.size(); ++c)
    for (const char* name : {"rx_rad", "ry_rad", "rz_rad", "x_mm", "y_mm", "z_mm"})
      parameters.push_back(out.rig.cameras[c].name + ".rig_from_camera." + name);
  return {{"kind", "rig_calibration"},
          {"board", job.board.text()},
          {"cameras", cameras},
          {"parameters", parameters},
          {"covariance", matrix_json(out.rig.covariance)},
          {"rms_px", out.rig.rms_px},
          {"held_out_px", out.rig.held_out_px},
          {"noise_scale", out.rig.noise_scale},
          {"shared_instants", out.rig.shared_instants},
          {"not_found", missing},
          {"warnings", out.rig.warnings}};
}

std::string camera_calibration_text(const CameraCalibrationOutput& out) {
  std::string text;
  for (const RigCameraResult& r : out.rig.cameras) {
    const CameraCalibration& c = r.camera;
    text += fmt::format("{}: {} views, RMS {:.3f} px, held out {:.3f} px\n", r.name, c.views.size(), c.rms_px,
                        c.held_out_px);
    const Vector9 k = intrinsics_of(c.model);
    for (int i = 0; i < kIntrinsics; ++i)
      text += fmt::format("  {:<6} {:>12.6g} ± {:.2g}\n", intrinsic_names()[static_cast<std::size_t>(i)],
                          k[i], c.sigma(i));
    if (&r == &out.rig.cameras[0]) continue;
    const Vector3 t = r.rig_from_camera.translation_mm;
    text += fmt::format(
        "  at ({:.3f} ± {:.3f}, {:.3f} ± {:.3f}, {:.3f} ± {:.3f}) mm in {}'s frame, turned by {:.3f} "
        "degrees; "
        "held out through the rig {:.3f} px\n",
        t.x(), std::sqrt(r.covariance(3, 3)), t.y(), std::sqrt(r.covariance(4, 4)), t.z(),
        std::sqrt(r.covariance(5, 5)), out.rig.cameras[0].name, r.rig_from_camera.angle_rad() * 180 / M_PI,
        r.held_out_rig_px);
  }
  if (!out.not_found.empty())
    text += fmt::format("no board in {} images, as {}: {}\n", out.not_found.size(), out.not_found[0].image,
                        out.not_found[0].reason);
  for (const std::string& w : out.rig.warnings) text += "warning: " + w + "\n";
  return text;
}

std::string calibration_rig_toml(const CameraCalibrationJob& job, const CameraCalibrationOutput& out) {
  const auto body = [](const char* key, const std::string& file) {
    return file.empty()
               ? fmt::format("# {0} = \"{0}.toml\"  # to be named before 'gnathion track' reads this\n", key)
               : fmt::format("{} = \"{}\"\n", key, file);
  };
  std::string text = "# Calibrated with " + job.board.text() +
                     ". The covariances are in the JSON beside it.\n" + body("bow", job.bow) +
                     body("head_frame", job.head_frame);
  for (const RigCameraResult& r : out.rig.cameras) {
    RigCamera camera;
    camera.name = r.name;
    camera.model = r.camera.model;
    camera.rig_from_camera = r.rig_from_camera;
    camera.focal_sigma_px = r.camera.focal_sigma_px();
    text += rig_camera_toml(camera);
  }
  return text;
}

Result<std::string> camera_calibration_picture(const CameraCalibrationOutput& out) {
  std::vector<std::shared_ptr<Drawing>> parts;
  double height = 0, width = 0;
  for (const RigCameraResult& r : out.rig.cameras) {
    parts.push_back(camera_drawing(r));
    height += parts.back()->height_pt();
    width = std::max(width, parts.back()->width_pt());
  }
  Drawing page(width, height);
  page.rectangle({0, 0}, {width, height}, filled({1, 1, 1}));
  double y = 0;
  for (const auto& p : parts) {
    page.place(p, {0, y});
    y += p->height_pt();
  }
  return png_bytes(page, 2.0);
}

}  // namespace gnathion
