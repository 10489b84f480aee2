// T_th from two intraoral scans, on real jaws moved by known motions.
//
//   scans_campaign [--first SEED] [--cases N] [--tissue MM] [--missing N] [--coarse MM]
//
// Each case: a pair of real arches (GNATHION_SHARED or ../shared, data/jaws); the scan in TP in any
// orientation, up to 60 mm off, the mandible in it moved by a T_th of up to 25°; both scans of each arch
// resampled independently, triangles shuffled, noise 0.02 mm on each; the scan in TP shows 60 % of each arch,
// cut off by a plane of random direction. --tissue: soft parts below the crowns shifted by up to MM;
// --missing: N teeth cut out of the scan in TP; --coarse: vertex spacing in TP (0.6 in MI).
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <map>
#include <string>

#include "calibration/composition.h"
#include "core/mesh_io.h"
#include "registration/scan_like_testing.h"

namespace gnathion {
namespace {

using namespace testing_surfaces;
constexpr double kDeg = 57.29577951308232;

struct Options {
  std::uint64_t first = 40001;
  int cases = 60, missing = 0;
  double tissue_mm = 0.0, tp_spacing_mm = 0.6;
};

struct Jaws {
  std::string name;
  TriangleMesh maxilla, mandible;
  /// Tessellations, made once: of MI and of TP, of neither the same.
  std::vector<TriangleMesh> maxilla_mi, mandible_mi, maxilla_tp, mandible_tp;
};

/// Soft tissue: what lies lower than the crowns' half by height over the arch's base.
TriangleMesh shifted_tissue(TriangleMesh mesh, double largest_mm, const Vector3& occlusal, Random& random) {
  const Box box = bounding_box(mesh);
  const double low = std::min(box.min_mm.dot(occlusal), box.max_mm.dot(occlusal)),
               high = std::max(box.min_mm.dot(occlusal), box.max_mm.dot(occlusal));
  const Vector3 wave = 0.15 * random.unit_vector(), direction = random.unit_vector();
  for (Vector3& p : mesh.vertices_mm) {
    const double depth = 1.0 - (p.dot(occlusal) - low) / (high - low);  // 0 at the cusps, 1 at the base
    const double soft = std::clamp((depth - 0.5) / 0.2, 0.0, 1.0);
    p += largest_mm * soft * std::sin(wave.dot(p)) * direction;
  }
  return mesh;
}

TriangleMesh without_teeth(const TriangleMesh& mesh, int count, Random& random) {
  return with_holes(mesh, count, 6.0, random);
}

class Campaign {
 public:
  explicit Campaign(const Options& o) : o_(o) {}

  int run() {
    for (const char* name : {"cast", "crowns"}) load(name);
    if (jaws_.empty()) {
      fmt::print(stderr, "scans_campaign: no real jaws: set GNATHION_SHARED\n");
      return 4;
    }
    for (int i = 0; i < o_.cases; ++i)
      one(jaws_[static_cast<std::size_t>(i) % jaws_.size()], o_.first + unsigned(i));
    report();
    return 0;
  }

 private:
  void load(const std::string& name) {
    constexpr int kTessellations = 3;
    Jaws j;
    j.name = name;
    const auto folder = shared_data() / "jaws" / name;
    const auto maxilla = read_mesh(folder / "maxilla.stl"), mandible = read_mesh(folder / "mandible_mi.stl");
    if (!maxilla || !mandible) return;
    j.maxilla = *maxilla;
    j.mandible = *mandible;
    Random random(o_.first);
    for (int k = 0; k < kTessellations; ++k) {
      j.maxilla_mi.push_back(retessellated(j.maxilla, 0.6, random));
      j.mandible_mi.push_back(retessellated(j.mandible, 0.6, random));
      j.maxilla_tp.push_back(retessellated(j.maxilla, o_.tp_spacing_mm, random));
      j.mandible_tp.push_back(retessellated(j.mandible, o_.tp_spacing_mm, random));
    }
    jaws_.push_back(std::move(j));
  }

  TriangleMesh scan_tp(const TriangleMesh& arch, const Vector3& occlusal, const Rigid3& pose,
                       Random& random) const {
    TriangleMesh scan = o_.tissue_mm > 0.0 ? shifted_tissue(arch, o_.tissue_mm, occlusal, random) : arch;
    if (o_.missing > 0) scan = without_teeth(scan, o_.missing, random);
    scan = part_of(with_holes(scan, 6, 1.2, random), 0.6, random.unit_vector());
    return transformed(pose, noisy(scan, 0.02, 0.0, 10, random));
  }

  void one(const Jaws& jaws, std::uint64_t seed) {
    Random random(seed);
    const auto pick = [&](const std::vector<TriangleMesh>& of) -> const TriangleMesh& {
      return of[random.below(static_cast<std::uint32_t>(of.size()))];
    };
    const Vector3 occlusal =
        (surface_centroid_mm(jaws.maxilla) - surface_centroid_mm(jaws.mandible)).normalized();
    const Rigid3 scan_from_dental = random_pose(random, 60);
    const Rigid3 truth =
        Rigid3::from_translation(2.0 * random.normal3()) *
        Rigid3::about_axis(60 * random.unit_vector(), random.unit_vector(), random.uniform(0.0, 25.0) / kDeg);
    const TriangleMesh maxilla_mi = noisy(pick(jaws.maxilla_mi), 0.02, 0.0, 10, random),
                       mandible_mi = noisy(pick(jaws.mandible_mi), 0.02, 0.0, 10, random);
    const TriangleMesh maxilla_tp = scan_tp(pick(jaws.maxilla_tp), -occlusal, scan_from_dental, random),
                       mandible_tp =
                           scan_tp(pick(jaws.mandible_tp), occlusal, scan_from_dental * truth, random);
    ChainOptions options;
    options.seed = seed;
    SilentProgress silent;
    const auto cpu = std::clock();
    const auto start = std::chrono::steady_clock::now();
    const auto found =
        therapeutic_from_scans(maxilla_mi, mandible_mi, maxilla_tp, mandible_tp, options, silent);
    seconds_.push_back(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
    cpu_seconds_.push_back(static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC);
    if (!found) {
      ++refused_;
      fmt::print(stderr, "case {} ({}): refused: {}\n", seed, jaws.name, found.error().line());
      return;
    }
    const PoseError e = pose_error(found->therapeutic.value.rigid, truth, jaws.mandible);
    const Vector6 xi = difference(truth, found->therapeutic.value.rigid);
    const Eigen::LDLT<Matrix6> ldlt(found->therapeutic.covariance);
    nees_.push_back(xi.dot(ldlt.solve(xi)) / 6.0);
    rms_mm_.push_back(e.rms_mm);
    max_mm_.push_back(e.max_mm);
    angles_deg_.push_back(e.angle_deg);
    if (e.rms_mm > 0.1) {
      ++wrong_;
      fmt::print(stderr, "case {} ({}): WRONG by {:.2f} mm\n", seed, jaws.name, e.rms_mm);
    }
  }

  void report() const {
    fmt::print(
        "{} cases from {}: {} refused as undetermined, {} off by more than 0.1 mm; tissue shift {} mm, {} "
        "teeth "
        "missing, spacing {} mm in TP\n\n",
        o_.cases, o_.first, refused_, wrong_, o_.tissue_mm, o_.missing, o_.tp_spacing_mm);
    if (rms_mm_.empty()) return;
    double sum = 0.0, mean_nees = 0.0;
    for (const double v : rms_mm_) sum += v * v / static_cast<double>(rms_mm_.size());
    for (const double v : nees_) mean_nees += v / static_cast<double>(nees_.size());
    const auto quantile = [](std::vector<double> v, double q) {
      std::sort(v.begin(), v.end());
      return v[std::min(v.size() - 1, static_cast<std::size_t>(q * static_cast<double>(v.size())))];
    };
    fmt::print(
        "| over the lower arch | mm |\n| --- | --- |\n| RMS over all cases | {:.4f} |\n| median RMS | {:.4f} "
        "|\n"
        "| 95th percentile RMS | {:.4f} |\n| largest RMS | {:.4f} |\n| largest at any vertex | {:.4f} |\n\n",
        std::sqrt(sum), quantile(rms_mm_, 0.5), quantile(rms_mm_, 0.95), quantile(rms_mm_, 1.0),
        quantile(max_mm_, 1.0));
    fmt::print("angle: median {:.4f} deg, largest {:.4f} deg; NEES/6 {:.2f}\n", quantile(angles_deg_, 0.5),
               quantile(angles_deg_, 1.0), mean_nees);
    fmt::print("time a case: median {:.2f} s, longest {:.2f} s; processor time: median {:.2f} s\n",
               quantile(seconds_, 0.5), quantile(seconds_, 1.0), quantile(cpu_seconds_, 0.5));
  }

  Options o_;
  std::vector<Jaws> jaws_;
  int refused_ = 0, wrong_ = 0;
  std::vector<double> rms_mm_, max_mm_, angles_deg_, nees_, seconds_, cpu_seconds_;
};

}  // namespace
}  // namespace gnathion

int main(int argc, char** argv) {
  gnathion::Options o;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string name = argv[i];
    const double value = std::strtod(argv[i + 1], nullptr);
    if (name == "--first") {
      o.first = static_cast<std::uint64_t>(value);
    } else if (name == "--cases") {
      o.cases = static_cast<int>(value);
    } else if (name == "--missing") {
      o.missing = static_cast<int>(value);
    } else if (name == "--tissue") {
      o.tissue_mm = value;
    } else if (name == "--coarse") {
      o.tp_spacing_mm = value;
    } else {
      std::fprintf(stderr, "unknown option %s\n", name.c_str());
      return 2;
    }
  }
  return gnathion::Campaign(o).run();
}
