#include "anatomy/xray.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>

namespace gnathion {
namespace {

constexpr double kStepVoxels = 0.7;  // between samples of a ray
constexpr double kAir = -1000.0;     // Hounsfield units

Vector3 orthogonal_up(const Vector3& beam, const Vector3& right) {
  return right.cross(beam).normalized();
}

/// A ray in voxel coordinates: sample n lies at start + (n + ½)·step.
struct Ray {
  Vector3 start, step;
};

/// Samples n in [first, last) of a ray that lie where low ≤ p ≤ high on all axes.
struct Samples {
  int first = 0, last = 0;
};
Samples inside(const Ray& ray, const Vector3& low, const Vector3& high, int count) {
  double first = 0.0, last = count;
  for (int a = 0; a < 3; ++a) {
    const double p = ray.start[a] + 0.5 * ray.step[a], d = ray.step[a];
    if (std::abs(d) < 1e-12) {
      if (p < low[a] || p > high[a]) return {};
      continue;
    }
    const double n0 = (low[a] - p) / d, n1 = (high[a] - p) / d;
    first = std::max(first, std::ceil(std::min(n0, n1)));
    last = std::min(last, std::floor(std::max(n0, n1)) + 1.0);
  }
  if (first >= last) return {};
  return {static_cast<int>(first), static_cast<int>(last)};
}

/// A block of values with two layers of zeros around it, so that no sample within asks for what is not there.
struct Block {
  static constexpr int kRim = 2;
  std::array<int, 3> size{};      ///< with the rim
  Vector3 low = Vector3::Zero();  ///< volume's voxel coordinates of the block's first voxel
  std::vector<float> value;

  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(size[0]) +
           static_cast<std::size_t>(i);
  }
};

/// Sum over the ray's samples, trilinear. The ray is told in the volume's voxel coordinates.
double sum_along(const Block& block, const Ray& ray, int count) {
  const Vector3 start = ray.start - block.low;
  const Vector3 low = Vector3::Constant(0.5);
  const Vector3 high(block.size[0] - 1.5, block.size[1] - 1.5, block.size[2] - 1.5);
  const Samples n = inside({start, ray.step}, low, high, count);
  const std::size_t along_j = static_cast<std::size_t>(block.size[0]);
  const std::size_t along_k = along_j * static_cast<std::size_t>(block.size[1]);
  const float* values = block.value.data();
  float sum = 0.0f;
  for (int s = n.first; s < n.last; ++s) {
    const float x = static_cast<float>(start.x() + (s + 0.5) * ray.step.x());
    const float y = static_cast<float>(start.y() + (s + 0.5) * ray.step.y());
    const float z = static_cast<float>(start.z() + (s + 0.5) * ray.step.z());
    const int i = static_cast<int>(x), j = static_cast<int>(y), k = static_cast<int>(z);
    const float u = x - static_cast<float>(i), v = y - static_cast<float>(j), w = z - static_cast<float>(k);
    const float* p = values + static_cast<std::size_t>(k) * along_k + static_cast<std::size_t>(j) * along_j +
                     static_cast<std::size_t>(i);
    const float a = p[0] + u * (p[1] - p[0]);
    const float b = p[along_j] + u * (p[along_j + 1] - p[along_j]);
    p += along_k;
    const float c = p[0] + u * (p[1] - p[0]);
    const float d = p[along_j] + u * (p[along_j + 1] - p[along_j]);
    const float e = a + v * (b - a), f = c + v * (d - c);
    sum += e + w * (f - e);
  }
  return sum;
}

bool is_unit_triad(const XrayView& v) {
  return std::abs(v.beam.norm() - 1.0) < 1e-6 && std::abs(v.right.norm() - 1.0) < 1e-6 &&
         std::abs(v.up.norm() - 1.0) < 1e-6 && std::abs(v.beam.dot(v.right)) < 1e-6 &&
         std::abs(v.beam.dot(v.up)) < 1e-6 && std::abs(v.right.dot(v.up)) < 1e-6;
}

}  // namespace

XrayView turned_view(double turn_deg, double tilt_deg, const ArchFrame& arch) {
  const double turn = turn_deg * M_PI / 180.0, tilt = tilt_deg * M_PI / 180.0;
  const Vector3 level = std::cos(turn) * arch.anterior - std::sin(turn) * arch.left;
  XrayView view;
  view.name =
      "turn " + std::to_string(std::lround(turn_deg)) + " tilt " + std::to_string(std::lround(tilt_deg));
  view.beam = std::cos(tilt) * level + std::sin(tilt) * arch.up;
  view.right = std::cos(turn) * arch.left + std::sin(turn) * arch.anterior;
  view.up = orthogonal_up(view.beam, view.right);
  if (view.up.dot(arch.up) < 0.0) view.up = -view.up;
  return view;
}

Result<XrayView> named_view(const std::string& name, const ArchFrame& arch) {
  XrayView view;
  if (name == "lateral") {
    view = turned_view(90.0, 0.0, arch);
  } else if (name == "frontal") {
    view = turned_view(0.0, 0.0, arch);
  } else if (name == "towne") {
    view = turned_view(0.0, 30.0, arch);
    view.beam = -view.beam;
  } else if (name == "submentovertex") {
    view.beam = arch.up;
    view.right = arch.left;
    view.up = arch.anterior;
  } else {
    return fail(ErrorCode::kUsage, "no such view", name,
                "lateral, frontal, towne, submentovertex, or TURN,TILT");
  }
  view.name = name;
  return view;
}

XrayWindow window_of(const XrayFilm& film) {
  std::vector<float> sorted = film.integral;
  if (sorted.empty()) return {};
  std::sort(sorted.begin(), sorted.end());
  const auto at = [&](double share) {
    return static_cast<double>(
        sorted[static_cast<std::size_t>(share * static_cast<double>(sorted.size() - 1))]);
  };
  XrayWindow window{at(0.02), at(0.995)};
  if (window.high - window.low < 1e-6) window.high = window.low + 1e-6;
  return window;
}

Image8 windowed(const XrayFilm& film, double low, double high) {
  Image8 image(film.size_px, film.size_px);
  const double scale = 255.0 / (high - low);
  for (std::size_t i = 0; i < film.integral.size(); ++i)
    image.pixels[i] = static_cast<std::uint8_t>(
        std::lround(std::clamp((static_cast<double>(film.integral[i]) - low) * scale, 0.0, 255.0)));
  return image;
}

struct JointXray::Beam {
  const Volume* volume = nullptr;
  VoxelMask mask;
  XrayView view;
  XrayOptions options;
  Transform<Cbct, Dental> cbct_from_dental;
  Motion<Dental> mi_from_scanned;
  Vector3 centre_mm = Vector3::Zero();
  double step_mm = 0.3;
  int samples = 0;
  Block moving;  ///< what the mandible attenuates beyond soft tissue, per mm
  XrayFilm resting;

  double attenuation(double value) const {
    return std::max(
        0.0, options.water_per_mm * (value - options.air_value) / (options.water_value - options.air_value));
  }

  /// Of a pixel, in Dental: where its ray begins, and one step along it.
  Ray ray_at(int column, int row) const {
    const double pitch = options.field_mm / options.size_px, middle = 0.5 * (options.size_px - 1);
    const Vector3 on_plane =
        centre_mm + (column - middle) * pitch * view.right + (middle - row) * pitch * view.up;
    Vector3 along = view.beam;
    if (options.source_mm > 0.0)
      along = (on_plane - (centre_mm - options.source_mm * view.beam)).normalized();
    // Slices at right angles to the beam's axis bound the ray, so that all rays have the same samples.
    const double longer = 1.0 / along.dot(view.beam);
    return {on_plane - 0.5 * options.depth_mm * longer * along, step_mm * longer * along};
  }
  Ray in_voxels(const Ray& dental, const Rigid3& cbct_from) const {
    const Matrix3 inverse = volume->grid.step_mm.inverse();
    return {inverse * (cbct_from * dental.start - volume->grid.origin_mm),
            inverse * (cbct_from.rotation * dental.step)};
  }
  /// Length of a step along a pixel's ray.
  static double step_length(const Ray& dental) { return dental.step.norm(); }

  /// Attenuation at a sample of the volume, trilinear; `with_mandible` false: soft tissue where it was.
  double at(const Vector3& p, bool with_mandible) const;
  XrayFilm through(bool with_mandible) const;
  void fill_moving();
};

double JointXray::Beam::at(const Vector3& p, bool with_mandible) const {
  const VoxelGrid& grid = volume->grid;
  int low[3];
  double part[3];
  for (int a = 0; a < 3; ++a) {
    if (!(p[a] > -1.0) || !(p[a] < grid.size[static_cast<std::size_t>(a)])) return 0.0;
    low[a] = static_cast<int>(std::floor(p[a]));
    part[a] = p[a] - low[a];
  }
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const int i = low[0] + (corner & 1), j = low[1] + (corner >> 1 & 1), k = low[2] + (corner >> 2);
    if (i < 0 || j < 0 || k < 0 || i >= grid.size[0] || j >= grid.size[1] || k >= grid.size[2]) continue;
    const double weight = (corner & 1 ? part[0] : 1.0 - part[0]) * (corner & 2 ? part[1] : 1.0 - part[1]) *
                          (corner & 4 ? part[2] : 1.0 - part[2]);
    const int mi = i - mask.low[0], mj = j - mask.low[1], mk = k - mask.low[2];
    const bool mandible = !with_mandible && mi >= 0 && mj >= 0 && mk >= 0 && mi < mask.size[0] &&
                          mj < mask.size[1] && mk < mask.size[2] && mask.inside[mask.index(mi, mj, mk)];
    sum += weight * attenuation(mandible ? options.soft_tissue : volume->value(i, j, k));
  }
  return sum;
}

XrayFilm JointXray::Beam::through(bool with_mandible) const {
  XrayFilm film{options.size_px, {}};
  film.integral.resize(static_cast<std::size_t>(options.size_px) * static_cast<std::size_t>(options.size_px));
  const Vector3 low = Vector3::Constant(-1.0);
  const Vector3 high(volume->grid.size[0], volume->grid.size[1], volume->grid.size[2]);
  tbb::parallel_for(0, options.size_px, [&](int row) {
    for (int column = 0; column < options.size_px; ++column) {
      const Ray dental = ray_at(column, row);
      const Ray ray = in_voxels(dental, cbct_from_dental.rigid);
      const Samples n = inside(ray, low, high, samples);
      double sum = 0.0;
      for (int s = n.first; s < n.last; ++s) sum += at(ray.start + (s + 0.5) * ray.step, with_mandible);
      film.integral[static_cast<std::size_t>(row) * static_cast<std::size_t>(options.size_px) +
                    static_cast<std::size_t>(column)] = static_cast<float>(sum * step_length(dental));
    }
  });
  return film;
}

void JointXray::Beam::fill_moving() {
  for (std::size_t a = 0; a < 3; ++a) {
    moving.size[a] = mask.size[a] + 2 * Block::kRim;
    moving.low[static_cast<Eigen::Index>(a)] = mask.low[a] - Block::kRim;
  }
  moving.value.assign(static_cast<std::size_t>(moving.size[0]) * static_cast<std::size_t>(moving.size[1]) *
                          static_cast<std::size_t>(moving.size[2]),
                      0.0f);
  const double soft = attenuation(options.soft_tissue);
  for (int k = 0; k < mask.size[2]; ++k)
    for (int j = 0; j < mask.size[1]; ++j)
      for (int i = 0; i < mask.size[0]; ++i)
        if (mask.inside[mask.index(i, j, k)])
          moving.value[moving.index(i + Block::kRim, j + Block::kRim, k + Block::kRim)] = static_cast<float>(
              attenuation(volume->value(mask.low[0] + i, mask.low[1] + j, mask.low[2] + k)) - soft);
}

JointXray::JointXray(std::unique_ptr<Beam> beam) : beam_(std::move(beam)) {}
JointXray::~JointXray() = default;
JointXray::JointXray(JointXray&&) noexcept = default;
JointXray& JointXray::operator=(JointXray&&) noexcept = default;
const XrayFilm& JointXray::resting() const {
  return beam_->resting;
}
XrayFilm JointXray::scanned() const {
  return beam_->through(true);
}

Result<JointXray> JointXray::create(const Volume& volume, const Transform<Cbct, Dental>& cbct_from_dental,
                                    const VoxelMask& mandible, const Vector3& centre_mm, const XrayView& view,
                                    const XrayOptions& options, const Motion<Dental>& scanned_from_mi) {
  const auto refused = [](const char* where, const char* why) {
    return fail(ErrorCode::kUsage, "cannot make an X-ray", where, why);
  };
  if (options.size_px < 8 || options.size_px > 4096) return refused("size", "8 to 4096 pixels a side");
  if (!(options.field_mm >= 5.0 && options.field_mm <= 400.0)) return refused("field", "5 to 400 mm");
  if (!(options.depth_mm >= 5.0 && options.depth_mm <= 600.0)) return refused("depth", "5 to 600 mm");
  if (options.source_mm != 0.0 && !(options.source_mm > options.depth_mm))
    return refused("source", "beyond the depth that is shown, or 0 for a parallel beam");
  if (!is_unit_triad(view)) return refused("view", "beam, right and up are not unit vectors at right angles");
  const Vector3 at = volume.grid.voxel_from_frame(cbct_from_dental * centre_mm);
  for (int a = 0; a < 3; ++a)
    if (!(at[a] >= 0.0 && at[a] <= volume.grid.size[static_cast<std::size_t>(a)] - 1))
      return bad_input("cannot make an X-ray", "volume", "it does not contain this joint");
  auto beam = std::make_unique<Beam>();
  beam->volume = &volume;
  beam->mask = mandible;
  beam->view = view;
  beam->options = options;
  beam->cbct_from_dental = cbct_from_dental;
  beam->mi_from_scanned = scanned_from_mi.inverse();
  beam->centre_mm = centre_mm;
  beam->step_mm = kStepVoxels * volume.grid.spacing_mm().minCoeff();
  beam->samples = static_cast<int>(std::ceil(options.depth_mm / beam->step_mm));
  beam->fill_moving();
  beam->resting = beam->through(false);
  return JointXray(std::move(beam));
}

XrayFilm JointXray::film(const Motion<Dental>& from_mi) const {
  const Beam& b = *beam_;
  XrayFilm film = b.resting;
  // What is at a place now was scanned where the motion undone brings that place.
  const Rigid3 moved = from_mi.rigid * b.mi_from_scanned.rigid;
  const Rigid3 cbct_from = b.cbct_from_dental.rigid * moved.inverse();
  tbb::parallel_for(0, b.options.size_px, [&](int row) {
    for (int column = 0; column < b.options.size_px; ++column) {
      const Ray dental = b.ray_at(column, row);
      const double sum = sum_along(b.moving, b.in_voxels(dental, cbct_from), b.samples);
      film.integral[static_cast<std::size_t>(row) * static_cast<std::size_t>(b.options.size_px) +
                    static_cast<std::size_t>(column)] += static_cast<float>(sum * Beam::step_length(dental));
    }
  });
  return film;
}

}  // namespace gnathion
