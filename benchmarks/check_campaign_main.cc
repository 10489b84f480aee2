// Realizability on fresh virtual patients: half of the transformations violate one constraint.
// check_campaign [--seeds N: transformations] [--first SEED]
#include <fmt/format.h>

#include <cstdlib>
#include <cstring>

#include "tests/support/realizability_trials.h"

int main(int argc, char** argv) {
  int wanted = 200, per_patient = 50;
  std::uint64_t first = 1;
  for (int i = 1; i + 1 < argc; i += 2) {
    if (std::strcmp(argv[i], "--seeds") == 0) wanted = std::atoi(argv[i + 1]);
    if (std::strcmp(argv[i], "--first") == 0) first = static_cast<std::uint64_t>(std::atoll(argv[i + 1]));
    if (std::strcmp(argv[i], "--per-patient") == 0) per_patient = std::atoi(argv[i + 1]);
  }
  gnathion::test::TrialCount all;
  for (std::uint64_t k = 0; all.trials < wanted; ++k) {
    const auto one =
        gnathion::test::run_trials(first + k, first + 1000 * k, std::min(per_patient, wanted - all.trials));
    all.trials += one.trials, all.violating += one.violating, all.wrong += one.wrong;
    all.refused_though_free += one.refused_though_free, all.distances += one.distances;
    all.worst_distance_mm = std::max(all.worst_distance_mm, one.worst_distance_mm);
    for (const std::string& f : one.failures) fmt::print("patient {}: {}\n", first + k, f);
    fmt::print("patient {}: {} transformations, {} wrong, condyle distances off by at most {:.4f} mm\n",
               first + k, one.trials, one.wrong, one.worst_distance_mm);
    std::fflush(stdout);
    if (one.trials == 0) return 1;
  }
  fmt::print(
      "{} transformations, {} of them violating: {} wrong, {} refused though free by 0.5 mm; {} condyle "
      "distances, worst {:.4f} mm off\n",
      all.trials, all.violating, all.wrong, all.refused_though_free, all.distances, all.worst_distance_mm);
  return all.wrong == 0 && all.worst_distance_mm <= 0.05 ? 0 : 1;
}
