// Transform files: the JSON of docs/formats.md, 16 numbers (row-major), ITK .tfm.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <nlohmann/json_fwd.hpp>

#include "core/result.h"
#include "core/transform.h"

namespace gnathion {

/// T_th as read from a file. Covariance is absent where the file does not know it.
struct MotionFile {
  Motion<Dental> motion;
  std::optional<Matrix6> covariance;
  std::string kind;  ///< "json", "text" or "itk"
};

/// Reads T_th. Refuses, with the deviation named: not 16 finite numbers, not rigid (determinant,
/// orthogonality, last row), a JSON of another kind, frame or unit.
/// ITK transforms map from-parent: the file's inverse is taken (no axis flip: meshes read as LPS).
Result<MotionFile> read_motion(const std::filesystem::path& path);
Result<MotionFile> parse_motion(const std::string& text, const std::string& name);

/// {"kind":"motion","frame":"dental","unit":"mm","matrix":…,"covariance":…|null,"source":…}
nlohmann::json motion_json(const Motion<Dental>& motion, const std::optional<Matrix6>& covariance,
                           const nlohmann::json& source);

nlohmann::json matrix_json(const Matrix4& m);      ///< four rows of four
nlohmann::json covariance_json(const Matrix6& m);  ///< six rows of six
Result<Matrix4> matrix_from_json(const nlohmann::json& j, const std::string& where);
Result<Matrix6> covariance_from_json(const nlohmann::json& j, const std::string& where);

/// Pretty-printed with a final newline, numbers that round-trip; whole or not at all.
Status write_json(const std::filesystem::path& path, const nlohmann::json& j);
Result<nlohmann::json> read_json(const std::filesystem::path& path);

}  // namespace gnathion
