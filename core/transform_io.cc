#include "core/transform_io.h"

#include <fmt/format.h>

#include <Eigen/Eigenvalues>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "core/file.h"

namespace gnathion {
namespace {

using nlohmann::json;
constexpr const char* kWhat = "cannot read transformation";

Result<Rigid3> checked_rigid(const Matrix4& m, const std::string& name) {
  const RigidityDeviation d = rigidity_deviation(m);
  if (!d.finite) return bad_input(kWhat, name, "has entries that are not finite");
  if (!d.is_rigid())
    return bad_input(
        kWhat, name,
        fmt::format("not a rigid transformation: determinant {:.6f} (1 expected), orthogonality off by "
                    "{:.3g}, last row off by {:.3g}",
                    d.determinant, d.orthogonality, d.last_row));
  return nearest_rigid(m);
}

/// Numbers separated by blanks, commas or semicolons; nothing else may stand between them.
Result<std::vector<double>> parse_numbers(const std::string& text, const std::string& name) {
  std::vector<double> values;
  const char* p = text.data();
  const char* end = p + text.size();
  while (true) {
    while (p < end && (std::isspace(static_cast<unsigned char>(*p)) || *p == ',' || *p == ';')) ++p;
    if (p == end) return values;
    if (*p == '+') ++p;
    double v = 0;
    const auto [next, ec] = std::from_chars(p, end, v);
    if (ec != std::errc())
      return bad_input(kWhat, name, fmt::format("not a number after {} numbers", values.size()));
    values.push_back(v);
    p = next;
  }
}

Result<MotionFile> parse_text(const std::string& text, const std::string& name) {
  std::string numbers;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) numbers += line.substr(0, line.find('#')) + "\n";
  GNATHION_TRY(const std::vector<double> v, parse_numbers(numbers, name));
  if (v.size() != 16) return bad_input(kWhat, name, fmt::format("{} numbers, 16 expected", v.size()));
  const Matrix4 m = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(v.data());
  GNATHION_TRY(const Rigid3 rigid, checked_rigid(m, name));
  return MotionFile{Motion<Dental>(rigid), std::nullopt, "text"};
}

Result<MotionFile> parse_json(const std::string& text, const std::string& name) {
  const json j = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (j.is_discarded() || !j.is_object()) return bad_input(kWhat, name, "not valid JSON");
  const auto expect = [&](const char* key, const char* value) -> Status {
    if (!j.contains(key)) return {};
    if (j[key] != value) return bad_input(kWhat, name, fmt::format("'{}' is not \"{}\"", key, value));
    return {};
  };
  GNATHION_CHECK_OK(expect("kind", "motion"));
  GNATHION_CHECK_OK(expect("frame", "dental"));
  GNATHION_CHECK_OK(expect("unit", "mm"));
  if (!j.contains("matrix")) return bad_input(kWhat, name, "no 'matrix'");
  GNATHION_TRY(const Matrix4 m, matrix_from_json(j["matrix"], name));
  GNATHION_TRY(const Rigid3 rigid, checked_rigid(m, name));
  MotionFile file{Motion<Dental>(rigid), std::nullopt, "json"};
  if (j.contains("covariance") && !j["covariance"].is_null()) {
    GNATHION_TRY(file.covariance, covariance_from_json(j["covariance"], name));
  }
  return file;
}

/// Rotation of an ITK Euler3D transform, ZXY order: R = Rz·Rx·Ry (itkEuler3DTransform's default).
Matrix3 euler_zxy(double rx, double ry, double rz) {
  return (Eigen::AngleAxisd(rz, Vector3::UnitZ()) * Eigen::AngleAxisd(rx, Vector3::UnitX()) *
          Eigen::AngleAxisd(ry, Vector3::UnitY()))
      .toRotationMatrix();
}

Result<MotionFile> parse_itk(const std::string& text, const std::string& name) {
  std::string kind;
  std::vector<double> parameters, centre;
  int transforms = 0;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const auto colon = line.find(':');
    if (line.empty() || line[0] == '#' || colon == std::string::npos) continue;
    const std::string key = line.substr(0, colon);
    std::string value = line.substr(colon + 1);
    value.erase(0, value.find_first_not_of(" \t"));
    value.erase(value.find_last_not_of(" \t\r") + 1);
    if (key == "Transform") {
      kind = value;
      ++transforms;
    }
    if (key == "Parameters") {
      GNATHION_TRY(parameters, parse_numbers(value, name));
    }
    if (key == "FixedParameters") {
      GNATHION_TRY(centre, parse_numbers(value, name));
    }
  }
  if (transforms != 1)
    return bad_input(kWhat, name, fmt::format("{} transforms in the file, 1 expected", transforms));
  Matrix3 r;
  Vector3 t;
  const auto begins = [&](const char* prefix) { return kind.rfind(prefix, 0) == 0; };
  if (begins("AffineTransform_double_3_3") || begins("MatrixOffsetTransformBase_double_3_3")) {
    if (parameters.size() != 12) return bad_input(kWhat, name, "an affine transform has 12 parameters");
    r = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(parameters.data());
    t = Eigen::Map<const Vector3>(parameters.data() + 9);
  } else if (begins("Euler3DTransform_double_3_3")) {
    if (parameters.size() != 6) return bad_input(kWhat, name, "an Euler transform has 6 parameters");
    if (centre.size() > 3 && centre[3] != 0)
      return bad_input(kWhat, name, "Euler angles in ZYX order are not supported");
    r = euler_zxy(parameters[0], parameters[1], parameters[2]);
    t = Eigen::Map<const Vector3>(parameters.data() + 3);
  } else if (begins("VersorRigid3DTransform_double_3_3")) {
    if (parameters.size() != 6) return bad_input(kWhat, name, "a versor transform has 6 parameters");
    const Vector3 v(parameters[0], parameters[1], parameters[2]);
    if (v.squaredNorm() > 1) return bad_input(kWhat, name, "the versor is longer than 1");
    r = Eigen::Quaterniond(std::sqrt(1 - v.squaredNorm()), v.x(), v.y(), v.z()).toRotationMatrix();
    t = Eigen::Map<const Vector3>(parameters.data() + 3);
  } else {
    return bad_input(kWhat, name, "ITK transform '" + kind + "' is not supported");
  }
  Vector3 c = Vector3::Zero();
  if (centre.size() >= 3) c = Eigen::Map<const Vector3>(centre.data());
  Matrix4 m = Matrix4::Identity();
  m.topLeftCorner<3, 3>() = r;
  m.topRightCorner<3, 1>() = t + c - r * c;
  GNATHION_TRY(const Rigid3 fixed_to_moving, checked_rigid(m, name));
  return MotionFile{Motion<Dental>(fixed_to_moving.inverse()), std::nullopt, "itk"};
}

template <int N>
Result<Eigen::Matrix<double, N, N>> square_from_json(const json& j, const std::string& where,
                                                     const char* name) {
  Eigen::Matrix<double, N, N> m;
  const std::string why = fmt::format("'{}' is not {}x{} numbers", name, N, N);
  if (!j.is_array() || j.size() != N) return bad_input(kWhat, where, why);
  for (std::size_t r = 0; r < N; ++r) {
    if (!j[r].is_array() || j[r].size() != N) return bad_input(kWhat, where, why);
    for (std::size_t c = 0; c < N; ++c) {
      if (!j[r][c].is_number()) return bad_input(kWhat, where, why);
      m(static_cast<int>(r), static_cast<int>(c)) = j[r][c].get<double>();
    }
  }
  return m;
}

template <class M>
json rows_json(const M& m) {
  json rows = json::array();
  for (int r = 0; r < m.rows(); ++r) {
    json row = json::array();
    for (int c = 0; c < m.cols(); ++c) row.push_back(m(r, c) + 0.0);  // + 0.0: no "-0.0" in files
    rows.push_back(row);
  }
  return rows;
}

}  // namespace

Result<MotionFile> parse_motion(const std::string& text, const std::string& name) {
  const auto first = text.find_first_not_of(" \t\r\n");
  if (first == std::string::npos) return bad_input(kWhat, name, "empty");
  if (text[first] == '{') return parse_json(text, name);
  if (text.compare(first, 12, "#Insight Tra") == 0) return parse_itk(text, name);
  return parse_text(text, name);
}

Result<MotionFile> read_motion(const std::filesystem::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  return parse_motion(text, path.string());
}

json motion_json(const Motion<Dental>& motion, const std::optional<Matrix6>& covariance, const json& source) {
  return {{"kind", "motion"},
          {"frame", "dental"},
          {"unit", "mm"},
          {"matrix", matrix_json(motion.rigid.matrix())},
          {"covariance", covariance ? covariance_json(*covariance) : json()},
          {"source", source}};
}

json matrix_json(const Matrix4& m) {
  return rows_json(m);
}
json covariance_json(const Matrix6& m) {
  return rows_json(m);
}
Result<Matrix4> matrix_from_json(const json& j, const std::string& where) {
  return square_from_json<4>(j, where, "matrix");
}
Result<Matrix6> covariance_from_json(const json& j, const std::string& where) {
  GNATHION_TRY(const Matrix6 m, square_from_json<6>(j, where, "covariance"));
  if (!m.allFinite() || !m.isApprox(m.transpose(), 1e-6))
    return bad_input(kWhat, where, "'covariance' is not symmetric");
  const double lowest =
      Eigen::SelfAdjointEigenSolver<Matrix6>(m, Eigen::EigenvaluesOnly).eigenvalues().minCoeff();
  if (lowest < -1e-9 * (1e-12 + m.trace()))
    return bad_input(kWhat, where, "'covariance' has a negative variance");
  return m;
}

Status write_json(const std::filesystem::path& path, const json& j) {
  return write_file(path, j.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

Result<json> read_json(const std::filesystem::path& path) {
  GNATHION_TRY(const std::string text, read_file(path));
  json j = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (j.is_discarded()) return bad_input("cannot read", path.string(), "not valid JSON");
  return j;
}

}  // namespace gnathion
