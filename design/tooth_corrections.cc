#include "design/tooth_corrections.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace gnathion {
namespace {

constexpr double kOnToothMm = 3.0;  // a label's place lies this near to the arch's surface

Status check_arch(const TriangleMesh& mesh, const NamedJaws& jaws, Arch which,
                  const ToothCorrections& teeth) {
  const std::vector<std::uint8_t> order = fdi_order(which);
  const auto ours = [&](std::uint8_t fdi) {
    return std::find(order.begin(), order.end(), fdi) != order.end();
  };
  const char* const name = which == Arch::kMaxilla ? "maxilla" : "mandible";
  const auto refuse = [&](const std::string& why) { return bad_input("cannot design", name, why); };
  std::string told;
  for (const ToothCorrections::Label& label : teeth.labels) {
    if (!ours(label.fdi)) continue;
    double nearest = 1e300;
    for (const Vector3& v : mesh.vertices_mm) nearest = std::min(nearest, (v - label.at_mm).norm());
    if (nearest > kOnToothMm)
      return refuse(fmt::format("the place of tooth {} is {:.1f} mm from this arch", label.fdi, nearest));
    told += fmt::format("{}{}", told.empty() ? "" : ", ", label.fdi);
  }
  for (const std::uint8_t fdi : teeth.missing)
    if (ours(fdi)) told += fmt::format("{}{} missing", told.empty() ? "" : ", ", fdi);
  if (told.empty() || !jaws.of(which).partition.fdi.empty()) return {};
  return refuse(fmt::format("no order of teeth along the arch agrees with the corrections ({})", told));
}

}  // namespace

Status check_tooth_corrections(const SplintInputs& inputs, const NamedJaws& jaws) {
  if (inputs.edits.teeth.empty()) return {};
  GNATHION_CHECK_OK(check_arch(inputs.maxilla, jaws, Arch::kMaxilla, inputs.edits.teeth));
  return check_arch(inputs.mandible_mi, jaws, Arch::kMandible, inputs.edits.teeth);
}

}  // namespace gnathion
