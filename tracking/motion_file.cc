#include "tracking/motion_file.h"

#include <cmath>
#include <cstdlib>

#include <fmt/format.h>

#include "core/file.h"

namespace gnathion {
namespace {

const char* const kColumns = "time_s,valid,reason,x_mm,y_mm,z_mm,qw,qx,qy,qz,sigma_mm";
constexpr std::size_t kColumnCount = 11;

/// Text for a CSV field: quoted when it holds a comma, a quote or a line's end.
std::string field(const std::string& text) {
  if (text.find_first_of(",\"\n\r") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c == '\n' || c == '\r' ? ' ' : c;
  }
  return quoted + '"';
}

std::vector<std::string> split(const std::string& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted) {
      if (c != '"') {
        fields.back() += c;
      } else if (i + 1 < line.size() && line[i + 1] == '"') {
        fields.back() += line[++i];
      } else {
        quoted = false;
      }
    } else if (c == '"') {
      quoted = true;
    } else if (c == ',') {
      fields.emplace_back();
    } else if (c != '\r') {
      fields.back() += c;
    }
  }
  return fields;
}

bool number(const std::string& text, double* value) {
  char* end = nullptr;
  *value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' && std::isfinite(*value);
}

/// The frame that the first comment line names; "dental" where there is none.
std::string frame_of(const std::string& comment) {
  const std::string key = "frame: ";
  const auto at = comment.find(key);
  if (at == std::string::npos) return {};
  const auto from = at + key.size();
  return comment.substr(from, comment.find_first_of(" ;,\r\n", from) - from);
}

/// One data row, or why not.
Result<JawMotionRow> parse_row(const std::string& line, const std::string& where) {
  const std::string what = "cannot read the motion";
  const std::vector<std::string> fields = split(line);
  if (fields.size() != kColumnCount) {
    return bad_input(what, where, fmt::format("{} columns, need {}", fields.size(), kColumnCount));
  }
  JawMotionRow row;
  if (!number(fields[0], &row.time_s)) return bad_input(what, where, "time_s is not a number: " + fields[0]);
  if (fields[1] != "0" && fields[1] != "1")
    return bad_input(what, where, "valid is neither 0 nor 1: " + fields[1]);
  row.valid = fields[1] == "1";
  row.reason = fields[2];
  if (!row.valid) return row;
  std::array<double, 8> n{};
  for (std::size_t i = 0; i < n.size(); ++i) {
    if (!number(fields[i + 3], &n[i])) return bad_input(what, where, "not a number: '" + fields[i + 3] + "'");
  }
  const Eigen::Quaterniond q(n[3], n[4], n[5], n[6]);
  if (std::abs(q.norm() - 1) > 1e-4) {
    return bad_input(what, where, fmt::format("the quaternion has length {:.6g}, not 1", q.norm()));
  }
  row.motion.rotation = q.normalized().toRotationMatrix();
  row.motion.translation_mm = {n[0], n[1], n[2]};
  row.sigma_mm = n[7];
  return row;
}

}  // namespace

JawMotion jaw_motion(const SessionMotion& session, const std::optional<Transform<HeadFrame, Bow>>& mi,
                     const std::optional<Transform<Bow, Dental>>& bow_from_dental, const Vector3& point_mm) {
  JawMotion result;
  result.frame = bow_from_dental ? Dental::name : HeadFrame::name;
  std::optional<Rigid3> reference;
  if (mi) reference = mi->rigid;
  result.relative_to_mi = mi.has_value();
  for (const MotionRow& row : session.rows) {
    JawMotionRow out;
    out.time_s = session.time_s(row);
    out.valid = row.valid();
    out.reason = row.reason();
    if (out.valid) {
      const Rigid3 r = row.head_from_bow().rigid;
      if (!reference) reference = r;
      Matrix6 cov = row.head_from_bow_covariance();
      out.motion = r * reference->inverse();  // in the head frame
      if (bow_from_dental) {
        // T_D⁻¹·R0⁻¹·(R·R0⁻¹)·R0·T_D: the same motion, told in the dental frame at MI.
        const Rigid3 dental_from_head = (*reference * bow_from_dental->rigid).inverse();
        out.motion = dental_from_head * out.motion * dental_from_head.inverse();
        const Matrix6 ad = adjoint(dental_from_head);
        cov = ad * cov * ad.transpose();
      }
      out.sigma_mm = std::sqrt(point_covariance(cov, out.motion * point_mm).trace());
    }
    result.rows.push_back(std::move(out));
  }
  return result;
}

std::string format_motion_csv(const JawMotion& motion) {
  std::string text = fmt::format(
      "# gnathion motion; frame: {}; {} relative to {}: p' = q*p + (x, y, z); rotation q, displacement of "
      "the frame's "
      "origin x, y, z; time from the first sample; sigma: of the reference point, one standard "
      "deviation\n{}\n",
      motion.frame, motion.frame == Dental::name ? "motion of the mandible" : "motion of the bow",
      motion.relative_to_mi ? "MI" : "the first valid row (no MI found)", kColumns);
  for (const JawMotionRow& row : motion.rows) {
    text += fmt::format("{:.6f},{},{},", row.time_s, row.valid ? 1 : 0, field(row.reason));
    if (row.valid) {
      Eigen::Quaterniond q(row.motion.rotation);
      if (q.w() < 0) q.coeffs() = -q.coeffs();
      const Vector3& t = row.motion.translation_mm;
      text += fmt::format("{:.6f},{:.6f},{:.6f},{:.9f},{:.9f},{:.9f},{:.9f},{:.5f}\n", t.x(), t.y(), t.z(),
                          q.w(), q.x(), q.y(), q.z(), row.sigma_mm);
    } else {
      text += ",,,,,,,\n";
    }
  }
  return text;
}

Status write_motion_csv(const std::filesystem::path& path, const JawMotion& motion) {
  return write_file(path, format_motion_csv(motion));
}

Result<JawMotion> parse_motion_csv(const std::string& text, const std::string& name) {
  const std::string what = "cannot read the motion";
  JawMotion motion;
  bool header = false;
  std::size_t line_number = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string line = text.substr(at, end - at);
    at = end + 1;
    ++line_number;
    const std::string where = fmt::format("{}, line {}", name, line_number);
    if (line.empty() || line == "\r") continue;
    if (line.front() == '#') {
      const std::string frame = frame_of(line);
      if (!frame.empty()) motion.frame = frame;
      continue;
    }
    if (!header) {
      if (line.substr(0, line.find('\r')) != kColumns) {
        return bad_input(what, where, fmt::format("the header is not {}", kColumns));
      }
      header = true;
      continue;
    }
    GNATHION_TRY(JawMotionRow row, parse_row(line, where));
    motion.rows.push_back(std::move(row));
  }
  if (!header) return bad_input(what, name, fmt::format("no header {}", kColumns));
  return motion;
}

Result<JawMotion> read_motion_csv(const std::filesystem::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  return parse_motion_csv(text, path.filename().string());
}

}  // namespace gnathion
