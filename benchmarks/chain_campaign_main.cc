// The chain's errors and forecasts on many virtual patients.
//
//   chain_campaign [--first SEED] [--seeds N] [--anatomies N] [--repeats N] [--clutches N] [--open]
//                  [--film] [--bend-um N]
//
// For each seed: scans with fresh poses, noise, scale signs, holes and soft-tissue shift; T_D, T_F, T, T_B
// and T_th by the face scans against the truth, at the patient's own TP (2–5° of opening), with --open at
// 25°. Anatomies (jaws, face, bow, seat) take longest to make and are shared by neighbouring seeds. --repeats
// N: N face scans in MI, N in TP and N clutch scans (or --clutches) go into the one problem. --film: the
// camera route, too, from the pixels of a filmed session (chain_campaign_film.h), and both routes fused; T_D
// is that of the scans. --bend-um N: the bow's model is bent against the bow by N µm at its ends.
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <string>
#include <vector>

#include "benchmarks/chain_campaign_film.h"
#include "calibration/chain.h"
#include "calibration/composition.h"
#include "core/progress.h"
#include "core/random.h"
#include "phantom/case.h"
#include "phantom/case_scans.h"
#include "phantom/film_scene.h"
#include "phantom/jaw_motion.h"
#include "phantom/patient.h"

namespace gnathion {
namespace {

constexpr double kDeg = 57.29577951308232;
/// χ² of 6 degrees of freedom that 95 % stay below.
constexpr double kChi2_6_95 = 12.591587243743977;

struct Options {
  std::uint64_t first = 7001;
  int seeds = 10, anatomies = 2, repeats = 1, clutches = 0, bend_um = 0;
  bool open = false, film = false;
};

/// What one kind of pose did over all seeds.
struct Tally {
  std::vector<double> angles_deg, all_teeth_mm, nees;
  std::vector<std::vector<double>> by_tooth_mm;

  void add(const Rigid3& found, const Matrix6& covariance, const Rigid3& truth,
           const std::vector<Vector3>& teeth_mm) {
    const Vector6 xi = difference(truth, found);
    nees.push_back(xi.dot(covariance.ldlt().solve(xi)) / 6.0);
    angles_deg.push_back((found * truth.inverse()).angle_rad() * kDeg);
    by_tooth_mm.resize(teeth_mm.size());
    double sum = 0.0;
    for (std::size_t i = 0; i < teeth_mm.size(); ++i) {
      const double d = (found * teeth_mm[i] - truth * teeth_mm[i]).norm();
      by_tooth_mm[i].push_back(d);
      sum += d * d;
    }
    all_teeth_mm.push_back(std::sqrt(sum / static_cast<double>(teeth_mm.size())));
  }
};

/// How long each of the solver's steps takes.
class StepTimes final : public Progress {
 public:
  void begin_step(std::string_view name, double) override {
    end();
    name_ = name;
    began_ = std::chrono::steady_clock::now();
  }
  void update(double) override {}
  void end() {
    if (!name_.empty())
      by_step[name_].push_back(
          std::chrono::duration<double>(std::chrono::steady_clock::now() - began_).count());
    name_.clear();
  }
  std::map<std::string, std::vector<double>> by_step;

 private:
  std::string name_;
  std::chrono::steady_clock::time_point began_;
};

double rms(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double v : values) sum += v * v;
  return std::sqrt(sum / static_cast<double>(values.size()));
}
double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  return values[std::min(values.size() - 1,
                         static_cast<std::size_t>(q * static_cast<double>(values.size())))];
}

void print(const std::string& name, const Tally& t) {
  double mean = 0.0, covered = 0.0, worst_rms = 0.0, worst_p95 = 0.0;
  for (const double n : t.nees) {
    mean += n / static_cast<double>(t.nees.size());
    covered += (6.0 * n <= kChi2_6_95 ? 100.0 : 0.0) / static_cast<double>(t.nees.size());
  }
  for (const auto& tooth : t.by_tooth_mm) {
    worst_rms = std::max(worst_rms, rms(tooth));
    worst_p95 = std::max(worst_p95, quantile(tooth, 0.95));
  }
  fmt::print("| {:<22} | {:>4} | {:.4f} | {:.4f} | {:.4f} | {:.4f} | {:.2f} | {:.1f} |\n", name,
             t.nees.size(), rms(t.all_teeth_mm), worst_rms, worst_p95, rms(t.angles_deg), mean, covered);
}

/// Centroid of each lower crown, Dental frame.
std::vector<Vector3> teeth_of(const PhantomJaws& jaws) {
  std::map<int, std::pair<Vector3, int>> sums;
  for (std::size_t v = 0; v < jaws.mandible_mi.vertices_mm.size(); ++v) {
    const int fdi = jaws.mandible_fdi[v];
    if (fdi == 0) continue;
    auto& [sum, count] = sums.try_emplace(fdi, Vector3::Zero(), 0).first->second;
    sum += jaws.mandible_mi.vertices_mm[v];
    ++count;
  }
  std::vector<Vector3> teeth;
  for (const auto& [fdi, s] : sums) teeth.push_back(s.first / s.second);
  return teeth;
}

std::vector<Vector3> moved(const Rigid3& x, std::vector<Vector3> points_mm) {
  for (Vector3& p : points_mm) p = x * p;
  return points_mm;
}

/// Quadratically, from the middle to both ends of its longest side, to a random one across it.
TriangleMesh bent(TriangleMesh mesh, double at_ends_mm, std::uint64_t seed) {
  const Box box = bounding_box(mesh);
  int longest = 0;
  const double half_mm = 0.5 * box.size_mm().maxCoeff(&longest);
  Random random(seed, 0x62656e64);
  Vector3 across = random.normal3();
  across[longest] = 0.0;
  across.normalize();
  for (Vector3& p : mesh.vertices_mm) {
    const double t = (p - box.centre_mm())[longest] / half_mm;
    p += at_ends_mm * t * t * across;
  }
  return mesh;
}

Motion<Dental> wide_opening(const PhantomPatient& patient) {
  JawGeometry geometry;
  geometry.condyle_left_mm = patient.jaws.landmarks.condyle_left_mm;
  geometry.condyle_right_mm = patient.jaws.landmarks.condyle_right_mm;
  geometry.incisal_point_mm = patient.jaws.landmarks.lower_incisal_point_mm;
  JawState state;
  state.opening_rad = 25.0 / kDeg;
  state.slide_left_mm = state.slide_right_mm = 6.0;
  return motion_of(state, geometry);
}

class Campaign {
 public:
  explicit Campaign(const Options& options) : options_(options) {}

  int run() {
    for (int i = 0; i < options_.seeds; ++i) {
      const int anatomy = i * options_.anatomies / options_.seeds;
      if (anatomy != anatomy_) {
        patient_ = make_phantom_patient(options_.first + 100000u * (1u + unsigned(anatomy)));
        if (options_.open) patient_.therapeutic = wide_opening(patient_);
        if (options_.film) film_ = film_scene(patient_);
      }
      anatomy_ = anatomy;
      one(options_.first + static_cast<std::uint64_t>(i));
    }
    report();
    return refused_ == 0 ? 0 : 1;
  }

 private:
  void one(std::uint64_t seed) {
    PhantomScanPoses poses = phantom_scan_poses(seed);
    ChainScans scans;
    scans.mandible_mi = simulate_phantom_scan(patient_, poses, PhantomScanKind::kMandibleMi, seed);
    scans.bow_model = patient_.bow.surface;
    if (options_.bend_um > 0) scans.bow_model = bent(scans.bow_model, 1e-3 * options_.bend_um, seed);
    scans.head_frame_model = patient_.head_frame.surface;
    for (int k = 0; k < std::max(options_.repeats, options_.clutches); ++k) repeat(poses, seed, k, scans);
    const auto start = std::chrono::steady_clock::now();
    ChainOptions chain_options;
    chain_options.seed = seed;
    const auto chain = solve_chain(scans, chain_options, steps_);
    steps_.end();
    const double took_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    seconds_.push_back(took_s);
    if (!chain) {
      ++refused_;
      fmt::print(stderr, "seed {}: {}\n", seed, chain.error().line());
      return;
    }
    for (const std::string& warning : chain->warnings) fmt::print(stderr, "seed {}: {}\n", seed, warning);
    warned_ += !chain->warnings.empty();
    tell(*chain, phantom_truth(patient_, poses));
    if (options_.film) tell_camera(*chain, seed);
    fmt::print(stderr,
               "seed {}: {:.2f} s, T_D {:.3f} T {:.3f} T_th {:.3f} mm, NEES/6 {:.2f} {:.2f} {:.2f} {:.2f}\n",
               seed, took_s, tallies_["T_D"].all_teeth_mm.back(), tallies_["T"].all_teeth_mm.back(),
               tallies_["T_th, face scans"].all_teeth_mm.back(), tallies_["T_D"].nees.back(),
               tallies_["T_F"].nees.back(), tallies_["T_B, face scans"].nees.back(),
               tallies_["T_th, face scans"].nees.back());
  }

  void repeat(const PhantomScanPoses& poses, std::uint64_t seed, int k, ChainScans& scans) {
    // The first scans' frames are those of the truth; later ones have poses of their own.
    PhantomScanPoses at = poses;
    std::uint64_t noise = seed;
    if (k > 0) {
      noise = seed + 1000003u * static_cast<std::uint64_t>(k);
      at = phantom_scan_poses(noise);
    }
    const auto scan = [&](PhantomScanKind kind) {
      return simulate_phantom_scan(patient_, at, kind, noise, seed);
    };
    if (k < options_.clutches) scans.clutch_scans.push_back(scan(PhantomScanKind::kMandibleClutch));
    if (k >= options_.repeats) return;
    scans.faces_mi.push_back(scan(PhantomScanKind::kFaceMi));
    scans.faces_tp.push_back(scan(PhantomScanKind::kFaceTp));
  }

  void tell(const Chain& chain, const PhantomTruth& truth) {
    const std::vector<Vector3> teeth = teeth_of(patient_.jaws);
    const std::vector<Vector3> teeth_in_face = moved(truth.dental_from_face.rigid.inverse(), teeth);
    tallies_["T_D"].add(chain.bow_from_dental.value, chain.bow_from_dental.covariance,
                        patient_.bow_from_dental.rigid, teeth);
    tallies_["T_F"].add(chain.bow_from_face.value, chain.bow_from_face.covariance, truth.bow_from_face.rigid,
                        teeth_in_face);
    tallies_["T"].add(chain.dental_from_face.value, chain.dental_from_face.covariance,
                      truth.dental_from_face.rigid, teeth_in_face);
    tallies_["head between scans"].add(
        chain.face_mi_from_face_tp.value, chain.face_mi_from_face_tp.covariance,
        truth.face_mi_from_face_tp.rigid, moved(truth.face_mi_from_face_tp.rigid.inverse(), teeth_in_face));
    tallies_["T_B, face scans"].add(chain.bow_motion.value, chain.bow_motion.covariance,
                                    truth.bow_motion.rigid, teeth_in_face);
    const Uncertain<Motion<Dental>> th = therapeutic_from_faces(chain).therapeutic;
    tallies_["T_th, face scans"].add(th.value.rigid, th.covariance, patient_.therapeutic.rigid, teeth);
  }

  void tell_camera(const Chain& chain, std::uint64_t seed) {
    const auto seen = filmed_positions(patient_, film_, seed);
    if (!seen) {
      ++refused_;
      fmt::print(stderr, "seed {}: {}\n", seed, seen.error().line());
      return;
    }
    const std::vector<Vector3> teeth = teeth_of(patient_.jaws);
    const auto add = [&](const char* name, const TherapeuticEstimate& th) {
      tallies_[name].add(th.therapeutic.value.rigid, th.therapeutic.covariance, patient_.therapeutic.rigid,
                         teeth);
    };
    ChainPose true_t_d;
    true_t_d.value = patient_.bow_from_dental.rigid;
    add("T_B, camera (T_D true)",
        therapeutic_from_camera(true_t_d, seen->head_from_bow_mi, seen->head_from_bow_tp));
    const TherapeuticEstimate camera =
        therapeutic_from_camera(chain.bow_from_dental, seen->head_from_bow_mi, seen->head_from_bow_tp);
    const TherapeuticEstimate faces = therapeutic_from_faces(chain);
    add("T_th, camera", camera);
    add("T_th, fused", fuse_routes(faces, camera, chain.bow_from_dental.covariance));
    consistent_ += compare_routes(camera, faces, chain.bow_from_dental.covariance, teeth).consistent ? 1 : 0;
    fmt::print(stderr, "seed {}: camera: T_B {:.4f} T_th {:.4f} fused {:.4f} mm\n", seed,
               tallies_["T_B, camera (T_D true)"].all_teeth_mm.back(),
               tallies_["T_th, camera"].all_teeth_mm.back(), tallies_["T_th, fused"].all_teeth_mm.back());
  }

  void report() const {
    fmt::print(
        "{} seeds from {}, {} anatomies, {} face scan(s) in MI, {} in TP, {} clutch scan(s), TP {}; {} "
        "refused, {} warned of\n\n",
        options_.seeds, options_.first, options_.anatomies, options_.repeats, options_.repeats,
        options_.clutches, options_.open ? "at 25° of opening" : "at 2–5° of opening", refused_, warned_);
    fmt::print(
        "| pose | n | teeth RMS mm | worst tooth RMS mm | worst tooth p95 mm | angle RMS deg | NEES/6 | in "
        "95 % ellipsoid, % |\n"
        "| --- | --- | --- | --- | --- | --- | --- | --- |\n");
    for (const auto& [name, tally] : tallies_)
      if (!tally.nees.empty()) print(name, tally);
    if (options_.film) fmt::print("\nroutes agree (p ≥ 0.003): {} of {}\n", consistent_, options_.seeds);
    if (!seconds_.empty())
      fmt::print("\nsolve_chain: median {:.2f} s, longest {:.2f} s\n", quantile(seconds_, 0.5),
                 *std::max_element(seconds_.begin(), seconds_.end()));
    for (const auto& [name, seconds] : steps_.by_step)
      fmt::print("  {}: median {:.2f} s\n", name, quantile(seconds, 0.5));
  }

  Options options_;
  PhantomPatient patient_;
  FilmScene film_;
  int anatomy_ = -1, refused_ = 0, warned_ = 0, consistent_ = 0;
  std::map<std::string, Tally> tallies_;
  std::vector<double> seconds_;
  StepTimes steps_;
};

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  gnathion::Options o;
  for (int i = 1; i < argc; ++i) {
    const std::string name = argv[i];
    if (name == "--open" || name == "--film") {
      (name == "--open" ? o.open : o.film) = true;
      continue;
    }
    if (i + 1 == argc) return 2;
    const long value = std::strtol(argv[++i], nullptr, 10);
    if (name == "--first") {
      o.first = static_cast<std::uint64_t>(value);
    } else if (name == "--seeds") {
      o.seeds = static_cast<int>(value);
    } else if (name == "--anatomies") {
      o.anatomies = static_cast<int>(value);
    } else if (name == "--repeats") {
      o.repeats = static_cast<int>(value);
    } else if (name == "--bend-um") {
      o.bend_um = static_cast<int>(value);
    } else if (name == "--clutches") {
      o.clutches = static_cast<int>(value);
    } else {
      std::fprintf(stderr, "unknown option %s\n", name.c_str());
      return 2;
    }
  }
  if (o.clutches == 0) o.clutches = o.repeats;
  return gnathion::Campaign(o).run();
}
