#include "phantom/cbct.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <cmath>

#include "core/file.h"
#include "core/mesh_query.h"
#include "core/random.h"
#include "phantom/bodies_field.h"

namespace gnathion {
namespace {

constexpr double kAir = -1000, kSoft = 40, kMarrow = 450, kCortex = 1500, kAlveolus = 1100, kDentine = 1700,
                 kEnamel = 2700;
constexpr double kDeepMm = 6.5;  ///< half a molar's width and more: no part of a solid lies deeper
constexpr int kBlock = 8;

/// Working field and the map to it. Float, for blur.
struct Canvas {
  std::array<int, 3> size;
  Vector3 step_mm, origin_mm;
  Rigid3 dental_from_cbct;
  std::vector<float> hu;

  std::size_t index(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size[1]) + static_cast<std::size_t>(j)) *
               static_cast<std::size_t>(size[0]) +
           static_cast<std::size_t>(i);
  }
  Vector3 dental(int i, int j, int k) const {
    return dental_from_cbct * (origin_mm + step_mm.cwiseProduct(Vector3(i, j, k)));
  }
  /// How much of a voxel lies inside, by the distance of its centre.
  double covered(double distance_mm) const {
    return std::clamp(0.5 - distance_mm / step_mm.mean(), 0.0, 1.0);
  }
  void blend(std::size_t voxel, double share, double value) {
    hu[voxel] += static_cast<float>(share * (value - static_cast<double>(hu[voxel])));
  }
};

struct Block {
  std::array<int, 3> low, high;
  Vector3 centre_mm;  ///< Dental
  double radius_mm;
};

/// Calls f(block) for all blocks of the canvas, on all cores; each voxel is in one block.
template <class F>
void for_blocks(const Canvas& c, F&& f) {
  const int nx = (c.size[0] + kBlock - 1) / kBlock, ny = (c.size[1] + kBlock - 1) / kBlock,
            nz = (c.size[2] + kBlock - 1) / kBlock;
  tbb::parallel_for(0, ny * nz, [&](int row) {
    for (int bx = 0; bx < nx; ++bx) {
      Block b;
      b.low = {bx * kBlock, row % ny * kBlock, row / ny * kBlock};
      for (std::size_t a = 0; a < 3; ++a) b.high[a] = std::min(b.low[a] + kBlock, c.size[a]);
      const Vector3 first = c.dental(b.low[0], b.low[1], b.low[2]),
                    last = c.dental(b.high[0] - 1, b.high[1] - 1, b.high[2] - 1);
      b.centre_mm = 0.5 * (first + last);
      b.radius_mm = 0.5 * (last - first).norm();
      f(b);
    }
  });
}

template <class F>
void for_voxels(const Canvas& c, const Block& b, F&& f) {
  for (int k = b.low[2]; k < b.high[2]; ++k)
    for (int j = b.low[1]; j < b.high[1]; ++j)
      for (int i = b.low[0]; i < b.high[0]; ++i) f(c.index(i, j, k), c.dental(i, j, k));
}

/// Calls f(voxel, signed distance) near and inside a surface that moved with `motion`.
template <class F>
void for_voxels_near(const Canvas& c, const TriangleMesh& mesh, const Rigid3& motion, F&& f) {
  const MeshQuery query(mesh);
  const Rigid3 back = motion.inverse();
  Box box = bounding_box(mesh);
  for_blocks(c, [&](const Block& b) {
    const Vector3 centre = back * b.centre_mm;
    const Vector3 beyond = (box.min_mm - centre).cwiseMax(centre - box.max_mm).cwiseMax(0.0);
    if (beyond.norm() > b.radius_mm + 1.0) return;
    const auto middle = query.signed_distance(centre, b.radius_mm + kDeepMm);
    if (!middle) return;
    if (!middle->closest.on_boundary && middle->distance_mm > b.radius_mm + 1.0) return;
    LocalQuery local(query);
    if (!local.gather(centre, b.radius_mm + 1e-6, kDeepMm)) return;
    for_voxels(c, b, [&](std::size_t voxel, const Vector3& p) {
      const auto found = local.signed_distance(back * p, kDeepMm);
      if (found && !found->closest.on_boundary) f(voxel, *found);
    });
  });
}

void paint_soft_tissue(Canvas& c, const FaceShape& face, bool skin) {
  if (!skin) {
    std::fill(c.hu.begin(), c.hu.end(), static_cast<float>(kSoft));
    return;
  }
  std::fill(c.hu.begin(), c.hu.end(), static_cast<float>(kAir));
  for_blocks(c, [&](const Block& b) {
    const double middle = skin_distance_mm(face, b.centre_mm);
    const double reach = 1.8 * (b.radius_mm + 1.0);  // the field is no exact distance
    if (middle > reach) return;
    for_voxels(c, b, [&](std::size_t voxel, const Vector3& p) {
      c.blend(voxel, middle < -reach ? 1.0 : c.covered(skin_distance_mm(face, p)), kSoft);
    });
  });
}

/// Crowns of enamel over dentine; under the gingiva, alveolar bone.
void paint_jaw(Canvas& c, const TriangleMesh& jaw, const std::vector<std::uint8_t>& fdi,
               const Rigid3& motion) {
  for_voxels_near(c, jaw, motion, [&](std::size_t voxel, const SignedDistance& d) {
    const Triangle& t = jaw.triangles[d.closest.triangle];
    Eigen::Index corner;
    d.closest.barycentric.maxCoeff(&corner);
    if (fdi[t[static_cast<std::size_t>(corner)]] != 0) {
      c.blend(voxel, c.covered(d.distance_mm), kEnamel);
      c.blend(voxel, c.covered(d.distance_mm + 1.6), kDentine);
    } else {
      c.blend(voxel, c.covered(d.distance_mm + 2.0), kAlveolus);
    }
  });
}

/// Cortex over marrow; the ramus goes on below the neck.
void paint_condyle(Canvas& c, const TriangleMesh& condyle, const Vector3& centre, double side,
                   const Rigid3& motion) {
  for_voxels_near(c, condyle, motion, [&](std::size_t voxel, const SignedDistance& d) {
    c.blend(voxel, c.covered(d.distance_mm), kCortex);
    c.blend(voxel, c.covered(d.distance_mm + 1.3), kMarrow);
  });
  const Vector3 neck = centre + Vector3(0, -3, -21.5), angle = centre + Vector3(-7 * side, -12, -52);
  const Rigid3 back = motion.inverse();
  for_blocks(c, [&](const Block& b) {
    if (field::rod(back * b.centre_mm, neck, angle, 3.4, 5.0) > b.radius_mm + 1.0) return;
    for_voxels(c, b, [&](std::size_t voxel, const Vector3& p) {
      const double d = field::rod(back * p, neck, angle, 3.4, 5.0);
      c.blend(voxel, c.covered(d), kCortex);
      c.blend(voxel, c.covered(d + 1.6), kMarrow);
    });
  });
}

/// The temporal bone: behind the fossa's surface, and the base of the skull over it.
void paint_fossa(Canvas& c, const TriangleMesh& fossa, const Vector3& centre) {
  constexpr double kThickMm = 4.0;
  for_voxels_near(c, fossa, Rigid3::identity(), [&](std::size_t voxel, const SignedDistance& d) {
    c.blend(voxel, std::min(c.covered(d.distance_mm), c.covered(-d.distance_mm - kThickMm)), kCortex);
  });
  for_blocks(c, [&](const Block& b) {
    const Vector3 middle = b.centre_mm - centre;
    if (std::abs(middle.z() - 12.0) > 4.0 + b.radius_mm || middle.head<2>().norm() > 18.0 + b.radius_mm)
      return;
    for_voxels(c, b, [&](std::size_t voxel, const Vector3& p) {
      const Vector3 q = p - centre;
      const double rim = (std::hypot(q.x() / 12.5, (q.y() + 2.5) / 16.5) - 1.0) * 12.5;
      c.blend(voxel, c.covered(std::max(std::abs(q.z() - 12.0) - 4.0, rim)), kCortex);
    });
  });
}

/// Weights of a Gaussian over whole voxels, sum 1.
std::vector<float> gaussian(double sigma_voxels) {
  const int reach = std::max(1, static_cast<int>(std::ceil(3.0 * sigma_voxels)));
  std::vector<float> w;
  double sum = 0.0;
  for (int i = -reach; i <= reach; ++i) sum += std::exp(-0.5 * i * i / (sigma_voxels * sigma_voxels));
  for (int i = -reach; i <= reach; ++i)
    w.push_back(static_cast<float>(std::exp(-0.5 * i * i / (sigma_voxels * sigma_voxels)) / sum));
  return w;
}

void blur_along(Canvas& c, int axis, double sigma_voxels) {
  if (sigma_voxels < 0.05) return;
  const std::vector<float> w = gaussian(sigma_voxels);
  const int reach = static_cast<int>(w.size() / 2), n = c.size[static_cast<std::size_t>(axis)];
  const int a = axis == 0 ? 1 : 0, b = axis == 2 ? 1 : 2;
  tbb::parallel_for(0, c.size[static_cast<std::size_t>(b)], [&](int v) {
    std::vector<float> line(static_cast<std::size_t>(n));
    for (int u = 0; u < c.size[static_cast<std::size_t>(a)]; ++u) {
      std::array<int, 3> at{};
      at[static_cast<std::size_t>(a)] = u;
      at[static_cast<std::size_t>(b)] = v;
      const std::size_t first = c.index(at[0], at[1], at[2]);
      at[static_cast<std::size_t>(axis)] = 1;
      const std::size_t stride = c.index(at[0], at[1], at[2]) - first;
      for (int i = 0; i < n; ++i)
        line[static_cast<std::size_t>(i)] = c.hu[first + static_cast<std::size_t>(i) * stride];
      for (int i = 0; i < n; ++i) {
        float sum = 0.0f;
        for (int k = -reach; k <= reach; ++k)
          sum += w[static_cast<std::size_t>(k + reach)] *
                 line[static_cast<std::size_t>(std::clamp(i + k, 0, n - 1))];
        c.hu[first + static_cast<std::size_t>(i) * stride] = sum;
      }
    }
  });
}

/// White before the blur, and so much that its 1σ after it is `noise_hu`. Each slice has a stream of its own.
void add_noise(Canvas& c, const PhantomCbctOptions& options) {
  double gain = 1.0;
  for (int a = 0; a < 3; ++a) {
    const double sigma = options.blur_mm / c.step_mm[a];
    if (sigma < 0.05) continue;
    double squares = 0.0;
    for (const float w : gaussian(sigma)) squares += static_cast<double>(w * w);
    gain *= std::sqrt(squares);
  }
  const std::size_t slice = static_cast<std::size_t>(c.size[0]) * static_cast<std::size_t>(c.size[1]);
  tbb::parallel_for(0, c.size[2], [&](int k) {
    Random random(options.seed, 0xCBC7000 + static_cast<std::uint64_t>(k));
    for (std::size_t v = 0; v < slice; ++v)
      c.hu[static_cast<std::size_t>(k) * slice + v] +=
          static_cast<float>(options.noise_hu / gain * random.normal());
  });
}

Canvas canvas_of(const PhantomJaws& jaws, const PhantomCbctOptions& options, Rigid3* cbct_from_dental) {
  Random random(options.seed, 0xCBC7);
  const Vector3 turn = 0.12 * random.normal3().cwiseMax(-1.5).cwiseMin(1.5);
  *cbct_from_dental = {exp_so3(turn), Vector3(12, -55, 30) + 10.0 * random.normal3()};
  Box field;  // in Dental, then around it in Cbct
  for (const Vector3& v : jaws.maxilla.vertices_mm) field.extend(v);
  for (const Vector3& v : jaws.mandible_mi.vertices_mm) field.extend(v);
  if (options.joints)
    for (const Vector3& centre : {jaws.landmarks.condyle_left_mm, jaws.landmarks.condyle_right_mm}) {
      field.extend(centre + Vector3(20, 24, 18));
      field.extend(centre - Vector3(20, 24, 26));
    }
  if (options.skin) {
    field.extend({-75, -42, -30});
    field.extend({75, 60, 75});
  }
  Box box;
  for (int corner = 0; corner < 8; ++corner) {
    Vector3 p;
    for (int a = 0; a < 3; ++a) p[a] = (corner >> a & 1) != 0 ? field.max_mm[a] : field.min_mm[a];
    box.extend(*cbct_from_dental * p);
  }
  Canvas c;
  const double slice = options.slice_mm > 0.0 ? options.slice_mm : options.voxel_mm;
  c.step_mm = {options.voxel_mm, options.voxel_mm, slice};
  c.origin_mm = box.min_mm;
  for (int a = 0; a < 3; ++a)
    c.size[static_cast<std::size_t>(a)] = static_cast<int>(std::ceil(box.size_mm()[a] / c.step_mm[a])) + 1;
  c.dental_from_cbct = cbct_from_dental->inverse();
  c.hu.resize(static_cast<std::size_t>(c.size[0]) * static_cast<std::size_t>(c.size[1]) *
              static_cast<std::size_t>(c.size[2]));
  return c;
}

}  // namespace

PhantomCbct make_phantom_cbct(const PhantomJaws& jaws, const FaceShape& face,
                              const PhantomCbctOptions& options) {
  Rigid3 pose;
  Canvas canvas = canvas_of(jaws, options, &pose);
  paint_soft_tissue(canvas, face, options.skin);
  if (options.joints) {
    paint_fossa(canvas, jaws.fossa_left, jaws.landmarks.condyle_left_mm);
    paint_fossa(canvas, jaws.fossa_right, jaws.landmarks.condyle_right_mm);
    paint_condyle(canvas, jaws.condyle_left, jaws.landmarks.condyle_left_mm, 1.0, options.mandible.rigid);
    paint_condyle(canvas, jaws.condyle_right, jaws.landmarks.condyle_right_mm, -1.0, options.mandible.rigid);
  }
  paint_jaw(canvas, jaws.maxilla, jaws.maxilla_fdi, Rigid3::identity());
  paint_jaw(canvas, jaws.mandible_mi, jaws.mandible_fdi, options.mandible.rigid);
  add_noise(canvas, options);
  for (int a = 0; a < 3; ++a) blur_along(canvas, a, options.blur_mm / canvas.step_mm[a]);

  PhantomCbct out;
  out.size = canvas.size;
  out.step_mm = canvas.step_mm;
  out.origin_mm = canvas.origin_mm;
  out.cbct_from_dental.rigid = pose;
  out.hu.resize(canvas.hu.size());
  for (std::size_t v = 0; v < out.hu.size(); ++v)
    out.hu[v] = static_cast<std::int16_t>(
        std::lround(std::clamp(static_cast<double>(canvas.hu[v]), -1024.0, 30000.0)));
  return out;
}

Status write_phantom_nrrd(const std::filesystem::path& path, const PhantomCbct& c) {
  std::string bytes = fmt::format(
      "NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: {} {} {}\n"
      "space directions: ({:.17g},0,0) (0,{:.17g},0) (0,0,{:.17g})\nkinds: domain domain domain\nendian: "
      "little\n"
      "encoding: raw\nspace origin: ({:.17g},{:.17g},{:.17g})\n\n",
      c.size[0], c.size[1], c.size[2], c.step_mm.x(), c.step_mm.y(), c.step_mm.z(), c.origin_mm.x(),
      c.origin_mm.y(), c.origin_mm.z());
  bytes.append(reinterpret_cast<const char*>(c.hu.data()), c.hu.size() * sizeof(std::int16_t));
  return write_file(path, bytes);
}

}  // namespace gnathion
