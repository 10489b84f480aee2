// What is known of a printer and its materials, from a named profile file (docs/printing.md).
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/rigid.h"

namespace gnathion {

struct PrintMaterial {
  std::string name;
  double gap_mm = 0.1;  ///< seat gap g that fits with this material on this printer
  std::string source;   ///< how it was found
};

struct PrinterProfile {
  std::string name, source;
  Vector3 room_mm = Vector3(120.0, 70.0, 150.0);  ///< plate (x, y) and height
  double margin_mm = 3.0;                         ///< kept free along the plate's edges
  double spacing_mm = 3.0;                        ///< between two parts
  double lift_mm = 5.0;                           ///< of the lowest point over the plate, for supports
  /// Steeper than this against the plate prints without supports.
  double self_supporting_deg = 45.0;
  /// Printed length divided by the one in the file, along the plate's axes; undone by the compensation.
  Vector3 printed_scale = Vector3::Ones();
  std::string scale_source;
  std::vector<PrintMaterial> materials;

  const PrintMaterial* material(std::string_view wanted) const;
};

/// Refused (kInput), by key: unknown keys, values out of range, a scale or a gap without its source.
Result<PrinterProfile> parse_printer_profile(std::string_view toml, const std::string& name);
Result<PrinterProfile> read_printer_profile(const std::filesystem::path& path);

}  // namespace gnathion
