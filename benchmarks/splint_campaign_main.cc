// Splints for fresh virtual patients and random T_th: each passes its gates or is refused by name.
// splint_campaign [--cases N] [--first SEED] [--voxel MM] [--per-patient N] [--arch maxilla|mandible] [--jaws
// FOLDER]
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <map>
#include <optional>
#include <string>

#include "anatomy/realizability.h"
#include "core/mesh_io.h"
#include "core/random.h"
#include "design/splint.h"
#include "occlusion/contacts.h"
#include "phantom/jaws.h"

namespace gnathion {
namespace {

constexpr double kFreeMm = 1.5;    // no refusal from this clearance on
constexpr double kBeyondMm = 0.1;  // no acceptance of jaws that intersect by more beyond MI
constexpr double kKept = 0.95;     // of MI's contact area outside apertures
constexpr double kMostDeg = 8.0, kMostMm = 5.0;

struct Options {
  int cases = 200, per_patient = 20;
  std::uint64_t first = 1;
  double voxel_mm = 0.2;
  Arch arch = Arch::kMaxilla;
  std::string jaws;  ///< folder with maxilla.stl and mandible_mi.stl instead of virtual patients
};

struct Pair {
  TriangleMesh maxilla, mandible_mi;
};

/// Every second one anywhere within 8° and 5 mm, the others openings about a hinge 90 mm behind with a shift.
Rigid3 random_therapeutic(Random& random, const ArchFrame& arch, bool opening) {
  const Vector3 direction = random.normal3().normalized();
  const double shift_mm = random.uniform(0.0, kMostMm);
  if (!opening) {
    const Vector3 axis = random.normal3().normalized();
    return Rigid3::from_translation(shift_mm * direction) *
           Rigid3::about_axis(arch.origin_mm, axis, random.uniform(0.0, kMostDeg) * M_PI / 180.0);
  }
  const Vector3 hinge = arch.origin_mm - 90.0 * arch.anterior + 30.0 * arch.up;
  // The front of the mandible goes down.
  const Rigid3 open = Rigid3::about_axis(hinge, arch.left, random.uniform(1.0, kMostDeg) * M_PI / 180.0);
  const Vector3 front = arch.origin_mm + 20.0 * arch.anterior;
  const bool down = arch.up.dot(open * front - front) < 0.0;
  Vector3 flat = direction - 0.9 * arch.up.dot(direction) * arch.up;
  return Rigid3::from_translation(0.6 * shift_mm * flat) * (down ? open : open.inverse());
}

struct Count {
  int cases = 0, passed = 0, not_realizable = 0, gate_refused = 0, errors = 0;
  int refused_though_clear = 0, accepted_though_overlapping = 0;
  std::map<std::string, int> by_reason;
  double seating_t_mm = 0.0, seating_deg = 0.0;
  double contact_p99_mm = 0.0, least_kept = 1.0;
  int kept_too_little = 0;  ///< less than the bar
};

void tell(const std::string& name, double clearance_mm, double beyond_mm, const std::string& what) {
  fmt::print("{}: clearance {:.2f} mm, beyond MI {:.2f} mm: {}\n", name, clearance_mm, beyond_mm, what);
  std::fflush(stdout);
}

/// Reasons that are the mandible's, not the jaws' distance: joints that are not free.
bool of_the_joints(const std::string& reason) {
  for (const char* part : {"condyle", "rotation", "yaw", "roll", "opening", "protrusion", "laterotrusion"})
    if (reason.find(part) != std::string::npos) return true;
  return false;
}

/// One T_th through check and design, judged by distances between the scans alone.
void run_case(const std::string& name, const Pair& pair, const RealizabilityChecker& checker,
              const MeshQuery& maxilla, const MeshQuery& mandible, double mi_depth_mm, const Rigid3& motion,
              const Options& options, Count& count) {
  const Overlap tp = find_overlap(maxilla, mandible, motion, checker.arch().up);
  const double clearance_mm = tp.depth_mm > 0.0 ? -tp.depth_mm : tp.min_distance_mm;
  const double beyond_mm = tp.depth_mm - mi_depth_mm;
  ++count.cases;
  const auto refused = [&](const std::vector<std::string>& why) {
    for (const std::string& reason : why) ++count.by_reason[reason];
    const bool wrong = clearance_mm >= kFreeMm && std::none_of(why.begin(), why.end(), of_the_joints);
    count.refused_though_clear += wrong;
    tell(name, clearance_mm, beyond_mm,
         fmt::format("refused, {}{}", fmt::join(why, ", "), wrong ? " (THOUGH CLEAR)" : ""));
  };
  const Feasibility feasibility = checker.check(Motion<Dental>(motion));
  if (feasibility.verdict == Verdict::kNotRealizable) {
    ++count.not_realizable;
    return refused(feasibility.violated());
  }
  SplintParameters parameters;
  parameters.voxel_mm = options.voxel_mm;
  SplintInputs inputs{pair.maxilla, pair.mandible_mi, Motion<Dental>(motion)};
  inputs.arch = options.arch;
  SilentProgress silent;
  const auto design = design_splint(inputs, parameters, silent);
  if (!design) {
    ++(design.error().code == ErrorCode::kGate ? count.gate_refused : count.errors);
    return refused({design.error().line()});
  }
  if (design->verdict != "pass") {
    ++count.gate_refused;
    std::vector<std::string> why;
    for (const Gate& gate : design->gates)
      if (gate.blocks && !gate.pass) {
        ++count.by_reason[gate.name];
        why.push_back(fmt::format("{} {:.3f}", gate.name, gate.value));
      }
    const bool wrong = clearance_mm >= kFreeMm;
    count.refused_though_clear += wrong;
    return tell(name, clearance_mm, beyond_mm,
                fmt::format("gates: {}{}", fmt::join(why, ", "), wrong ? " (THOUGH CLEAR)" : ""));
  }
  ++count.passed;
  const bool overlapping = beyond_mm > kBeyondMm;
  count.accepted_though_overlapping += overlapping;
  const SplintVerification& v = design->verification;
  double t_mm = -1.0, alpha_deg = -1.0;
  if (v.predicted_seating) {
    t_mm = v.predicted_seating->t_mm;
    alpha_deg = v.predicted_seating->alpha_deg;
  }
  count.seating_t_mm = std::max(count.seating_t_mm, t_mm);
  count.seating_deg = std::max(count.seating_deg, alpha_deg);
  count.contact_p99_mm = std::max(count.contact_p99_mm, v.contact_surface_error.p99_mm);
  count.least_kept = std::min(count.least_kept, v.kept_outside_apertures);
  count.kept_too_little += v.kept_outside_apertures < kKept;
  tell(name, clearance_mm, beyond_mm,
       fmt::format(
           "passes{}, kept outside apertures {:.3f}, p99 {:.4f}, seating {:.4f} mm {:.4f}°, {} apertures",
           overlapping ? " (THOUGH OVERLAPPING)" : "", v.kept_outside_apertures,
           v.contact_surface_error.p99_mm, t_mm, alpha_deg, v.apertures.size()));
}

Result<Pair> make_pair_of(const Options& options, std::uint64_t seed) {
  if (options.jaws.empty()) {
    PhantomJaws jaws = make_phantom_jaws(seed);
    return Pair{std::move(jaws.maxilla), std::move(jaws.mandible_mi)};
  }
  Pair pair;
  GNATHION_TRY(pair.maxilla, read_jaw(options.jaws + "/maxilla.stl"));
  GNATHION_TRY(pair.mandible_mi, read_jaw(options.jaws + "/mandible_mi.stl"));
  return pair;
}

bool run_patient(const Options& options, std::uint64_t seed, Count& count) {
  const auto pair = make_pair_of(options, seed);
  if (!pair) {
    fmt::print(stderr, "{}\n", pair.error().line());
    return false;
  }
  const auto checker = RealizabilityChecker::create(pair->maxilla, pair->mandible_mi);
  if (!checker) {
    fmt::print(stderr, "patient {}: {}\n", seed, checker.error().line());
    return false;
  }
  const MeshQuery maxilla(pair->maxilla), mandible(pair->mandible_mi);
  const double mi_depth_mm = find_overlap(maxilla, mandible, Rigid3::identity(), checker->arch().up).depth_mm;
  Random random(7919 * seed + 13);
  for (int n = 0; n < options.per_patient && count.cases < options.cases; ++n)
    run_case(fmt::format("patient {} case {}", seed, n), *pair, *checker, maxilla, mandible, mi_depth_mm,
             random_therapeutic(random, checker->arch(), n % 2 == 1), options, count);
  return true;
}

int run(const Options& options) {
  Count count;
  for (std::uint64_t seed = options.first; count.cases < options.cases; ++seed)
    if (!run_patient(options, seed, count)) return 1;
  fmt::print(
      "{} cases: {} pass, {} not realizable, {} refused by a gate, {} errors; refused though clear by {} mm: "
      "{}; accepted though more than {} mm beyond MI: {}; worst predicted seating {:.4f} mm, {:.4f}°\n",
      count.cases, count.passed, count.not_realizable, count.gate_refused, count.errors, kFreeMm,
      count.refused_though_clear, kBeyondMm, count.accepted_though_overlapping, count.seating_t_mm,
      count.seating_deg);
  fmt::print(
      "contact area kept outside apertures: least {:.3f}, under {} in {} of {}; worst p99 of contact "
      "surfaces {:.4f} mm\n",
      count.least_kept, kKept, count.kept_too_little, count.passed, count.contact_p99_mm);
  for (const auto& [reason, cases] : count.by_reason) fmt::print("  {}: {}\n", reason, cases);
  return count.refused_though_clear + count.accepted_though_overlapping + count.errors == 0 ? 0 : 1;
}

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  gnathion::Options options;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string key = argv[i], value = argv[i + 1];
    if (key == "--cases") options.cases = std::atoi(value.c_str());
    if (key == "--first") options.first = static_cast<std::uint64_t>(std::atoll(value.c_str()));
    if (key == "--voxel") options.voxel_mm = std::atof(value.c_str());
    if (key == "--per-patient") options.per_patient = std::atoi(value.c_str());
    if (key == "--arch" && value == "mandible") options.arch = gnathion::Arch::kMandible;
    if (key == "--jaws") options.jaws = value;
  }
  return gnathion::run(options);
}
