#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>

#include "core/mesh_query.h"
#include "design/parallel.h"
#include "design/verification_steps.h"

namespace gnathion {
namespace {

constexpr double kSmallestMm2 = 0.02;  // below this it is no opening but the grid's noise

/// Area of the film's middle surface {C = K} that one node stands for (smeared delta function, Engquist et
/// al. 2005), and the film's thickness there.
struct FilmSample {
  float area_mm2 = 0.0f;
  float thickness_mm = 1e9f;
};

std::vector<FilmSample> sampled_film(const SplintField& field, const GridShape& shape) {
  const double h = shape.spacing_mm;
  const SplintParameters& par = field.parameters();
  std::vector<FilmSample> film(shape.size());
  parallel_each(shape.nodes.x(), [&](int i) {
    for (int j = 0; j < shape.nodes.y(); ++j)
      for (int k = 0; k < shape.nodes.z(); ++k) {
        const Vector3 p = shape.position(i, j, k);
        const FieldTerms at = field.estimate(p);
        const double thickness = at.cavity + at.cut;
        if (thickness > par.aperture_limit_mm || at.body > 0.0 || at.rim > 0.0) continue;
        const double difference = at.cavity - at.cut;
        if (std::abs(difference) > 6.0 * h) continue;
        Vector3 gradient;
        for (int d = 0; d < 3; ++d) {
          const Vector3 step = 0.5 * h * Vector3::Unit(d);
          const FieldTerms up = field.estimate(p + step), down = field.estimate(p - step);
          gradient[d] = ((up.cavity - up.cut) - (down.cavity - down.cut)) / h;
        }
        const double width = 1.5 * h * gradient.lpNorm<1>();  // support of the delta function
        if (std::abs(difference) >= width) continue;
        const double delta = (1.0 - std::abs(difference) / width) / width;
        film[shape.index(i, j, k)] = {static_cast<float>(delta * gradient.norm() * h * h * h),
                                      static_cast<float>(thickness)};
      }
  });
  return film;
}

std::vector<std::uint8_t> teeth_near(const Vector3& centre_mm, double radius_mm, const TriangleMesh& support,
                                     const std::vector<std::uint8_t>& fdi) {
  std::set<std::uint8_t> teeth;
  for (std::size_t v = 0; v < fdi.size(); ++v)
    if (fdi[v] != 0 && (support.vertices_mm[v] - centre_mm).norm() < radius_mm) teeth.insert(fdi[v]);
  return {teeth.begin(), teeth.end()};
}

}  // namespace

std::vector<Aperture> found_apertures(const SplintField& field, const TriangleMesh& support_dental,
                                      const std::vector<std::uint8_t>& support_fdi, Arch arch) {
  const char* const opposing = arch == Arch::kMaxilla ? "mandible in TP" : "maxilla in TP";
  const Preparation& prep = field.preparation();
  const GridShape& shape = prep.coarse;
  const std::vector<FilmSample> film = sampled_film(field, shape);
  const Rigid3 dental_from_design = prep.design_from_dental.inverse();
  std::vector<char> seen(film.size(), 0);
  std::vector<Aperture> out;
  for (std::size_t start = 0; start < film.size(); ++start) {
    if (film[start].area_mm2 <= 0.0f || seen[start]) continue;
    std::vector<std::size_t> stack{start};
    seen[start] = 1;
    double area = 0.0, thinnest = 1e9;
    Vector3 moment = Vector3::Zero();
    while (!stack.empty()) {
      const std::size_t at = stack.back();
      stack.pop_back();
      const int nz = shape.nodes.z(), ny = shape.nodes.y();
      const int k = static_cast<int>(at % static_cast<std::size_t>(nz));
      const int j = static_cast<int>(at / static_cast<std::size_t>(nz) % static_cast<std::size_t>(ny));
      const int i = static_cast<int>(at / static_cast<std::size_t>(nz) / static_cast<std::size_t>(ny));
      area += film[at].area_mm2;
      thinnest = std::min<double>(thinnest, film[at].thickness_mm);
      moment += film[at].area_mm2 * shape.position(i, j, k);
      for (int n = 0; n < 27; ++n) {
        const int a = i + n % 3 - 1, b = j + n / 3 % 3 - 1, c = k + n / 9 - 1;
        if (a < 0 || b < 0 || c < 0 || a >= shape.nodes.x() || b >= ny || c >= nz) continue;
        const std::size_t next = shape.index(a, b, c);
        if (film[next].area_mm2 <= 0.0f || seen[next]) continue;
        seen[next] = 1;
        stack.push_back(next);
      }
    }
    if (area < kSmallestMm2) continue;
    Aperture aperture;
    aperture.area_mm2 = area;
    aperture.centre_mm = dental_from_design * Vector3(moment / area);
    aperture.teeth =
        teeth_near(aperture.centre_mm, 1.5 + std::sqrt(area / M_PI), support_dental, support_fdi);
    aperture.cause = thinnest > 0.0
                         ? fmt::format("{} leaves {:.2f} mm of wall over the cavity", opposing, thinnest)
                         : fmt::format("{} reaches {:.2f} mm into the cavity's gap", opposing, -thinnest);
    out.push_back(std::move(aperture));
  }
  std::stable_sort(out.begin(), out.end(),
                   [](const Aperture& a, const Aperture& b) { return a.area_mm2 > b.area_mm2; });
  return out;
}

std::vector<Aperture> drawn_apertures(const SplintEdits& edits, const Rigid3& design_from_dental,
                                      const TriangleMesh& support_dental,
                                      const std::vector<std::uint8_t>& support_fdi) {
  std::vector<Aperture> out;
  for (const Region& region : edits.cutouts) {
    Aperture aperture;
    double twice_area = 0.0;
    Vector3 before = design_from_dental * region.outline_mm.back();
    for (const Vector3& p : region.outline_mm) {
      const Vector3 here = design_from_dental * p;
      twice_area += before.x() * here.y() - before.y() * here.x();
      before = here;
      aperture.centre_mm += p / static_cast<double>(region.outline_mm.size());
    }
    aperture.area_mm2 = 0.5 * std::abs(twice_area);
    aperture.teeth = teeth_near(aperture.centre_mm, 1.5 + std::sqrt(aperture.area_mm2 / M_PI), support_dental,
                                support_fdi);
    aperture.cause = "drawn cutout";
    out.push_back(std::move(aperture));
  }
  return out;
}

}  // namespace gnathion
