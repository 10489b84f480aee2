#include "calibration/chain_registrations.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>

#include <algorithm>

#include "registration/coarse.h"
#include "registration/mirrored.h"

namespace gnathion {
namespace {

enum Scanner { kIntraoral = 0, kClutch, kFace, kScanners };

constexpr double kScanNoise_mm = 0.03;  // of two scans against each other
constexpr double kOnBow_mm = 1.0;       // a face scan's surface this near to the found bow is the bow's
constexpr double kOffBow_mm = 4.0;      // and beyond this it is not
constexpr double kRigidHead_mm = 0.04;  // soft tissue that shifts more is not head
constexpr std::size_t kPointsPerTerm = 6000;

/// Distance of each triangle to a surface under a pose, its corners' mean; `far_mm` where there is none
/// nearer.
std::vector<double> distances_to(const TriangleMesh& mesh, const MeshQuery& surface,
                                 const Rigid3& surface_from_mesh, double far_mm) {
  std::vector<Vector3> corners;
  corners.reserve(mesh.vertices_mm.size());
  for (const Vector3& v : mesh.vertices_mm) corners.push_back(surface_from_mesh * v);
  const std::vector<ClosestHit> hits = closest_points(surface, corners, far_mm);
  std::vector<double> out(mesh.triangles.size(), 0.0);
  for (std::size_t t = 0; t < out.size(); ++t) {
    for (const std::uint32_t v : mesh.triangles[t]) {
      const bool near = hits[v].triangle != ClosestHit::kNoTriangle;
      out[t] += near ? std::abs(hits[v].distance_mm) : far_mm;
    }
    out[t] /= 3.0;
  }
  return out;
}

std::vector<bool> where(const std::vector<double>& values, double low, double high) {
  std::vector<bool> out(values.size());
  for (std::size_t i = 0; i < values.size(); ++i) out[i] = values[i] >= low && values[i] <= high;
  return out;
}

std::vector<bool> all_of(const TriangleMesh& mesh) {
  return std::vector<bool>(mesh.triangles.size(), true);
}

CoarseOptions coarse(const std::string& name, double overlap, std::uint64_t seed) {
  CoarseOptions o;
  o.name = name;
  o.overlap = overlap;
  o.noise_mm = kScanNoise_mm;
  o.seed = seed;
  return o;
}

IcpResult fitted(const SearchSurface& source, const SearchSurface& target, const MeshQuery& query,
                 const Rigid3& start, double first_gate_mm, std::uint64_t seed) {
  IcpOptions icp;
  icp.first_gate_mm = first_gate_mm;
  icp.last_gate_mm = 0.6;
  icp.noise_mm = 0.5 * kScanNoise_mm;
  icp.settled_mm = 3e-3;  // the joint problem does the rest
  return robust_icp(sample_surface(*source.mesh, source.keep, 3000, seed), query, target.keep, start, icp);
}

/// Coarse search and a first fit of the kept part of `source` on the kept part of `target`.
Result<Rigid3> locate(const SearchSurface& source, const SearchSurface& target, const MeshQuery& query,
                      const CoarseOptions& options) {
  constexpr double kDoubtful_mm = 0.15;  // two scans of one body leave less
  const auto pose_of = [&](const SearchSurface& moving) -> Result<IcpResult> {
    GNATHION_TRY(const CoarseMatch match, find_pose(moving, target, query, options));
    return fitted(moving, target, query, match.target_from_source, 2.0, options.seed);
  };
  const Result<IcpResult> direct = pose_of(source);
  if (direct && direct->scale_mm < kDoubtful_mm) return direct->target_from_source;
  const TriangleMesh image = mirrored(*source.mesh);
  const Result<IcpResult> reflected = pose_of({&image, source.keep});
  if (reflected && reflected->scale_mm < kDoubtful_mm &&
      (!direct || reflected->scale_mm < 0.5 * direct->scale_mm))
    return bad_input("cannot align", options.name, kMirroredWhy);
  if (!direct) return tl::unexpected<Error>(direct.error());
  return direct->target_from_source;
}

/// The same where a guess may be near: nothing unless most of the source comes to lie on the target.
std::optional<Rigid3> locate_near(const SearchSurface& source, const SearchSurface& target,
                                  const MeshQuery& query, const Rigid3& guess, std::uint64_t seed) {
  constexpr double kReach_mm = 12.0, kLargestScale_mm = 0.2, kLeastShare = 0.6;
  const IcpResult fit = fitted(source, target, query, guess, kReach_mm, seed);
  const auto used =
      std::count_if(fit.pairs.begin(), fit.pairs.end(), [](const PlanePair& p) { return p.weight > 0.0; });
  if (!fit.converged || fit.scale_mm > kLargestScale_mm || static_cast<double>(used) < kLeastShare * 3000)
    return std::nullopt;
  return fit.target_from_source;
}

enum class Onto { kScan, kCad };

SurfaceTerm term_of(std::string name, const ChainSurface& scan, const std::vector<bool>& keep, int scanner,
                    const ChainSurface& surface, Onto onto, ChainNoisePool pool, std::uint64_t seed) {
  SurfaceTerm term;
  term.name = std::move(name);
  term.surface = &*surface.query;
  term.scanner = scanner;
  term.scale_centre_mm = scan.centre_mm;
  term.noise_pool = pool;
  // Chords of two scans sag alike; beside a CAD surface they would pull the scan out of it. A mesh of few
  // vertices tells more by its faces all the same.
  constexpr std::size_t kSamples = kPointsPerTerm * 5 / 4, kFewVertices = 1000;
  SurfaceSamples samples;
  if (onto == Onto::kCad) samples = sample_vertices(scan.mesh, keep, kSamples, seed);
  if (samples.size() < kFewVertices) samples = sample_surface(scan.mesh, keep, kSamples, seed);
  set_samples(term, samples);
  return term;
}

std::string numbered(const char* name, std::size_t index, std::size_t count) {
  return count < 2 ? std::string(name) : fmt::format("{} {}", name, index + 1);
}

/// What the steps below have in common.
class Registrar {
 public:
  Registrar(const ChainScans& scans, const ChainOptions& options) : scans_(scans), seed_(options.seed) {
    start_.unknowns = unknowns_of(scans);
    start_.problem.poses.resize(static_cast<std::size_t>(start_.unknowns.count));
    start_.problem.fixed.assign(start_.problem.poses.size(), false);
    start_.problem.scale_sigmas.assign(kScanners, options.scan_scale_sigma);
    tracked_ = options.tracked;
    build_surfaces();
    mandible_ = surface_of(scans.mandible_mi);
    bow_ = surface_of(scans.bow_model);
    if (!scans.head_frame_model.empty() && !scans.faces_mi.empty())
      head_frame_ = surface_of(scans.head_frame_model);
  }

  /// The bow in the first scan of each kind, and its repeats on it. These searches do not hang together, and
  /// run side by side.
  Status search_all();
  void add_clutch_scans();
  Status add_face_scans();
  ChainStart done() { return std::move(start_); }

 private:
  /// A face scan, by triangle: how far from the bow, and what is not near it.
  struct Face {
    const ChainSurface* surface = nullptr;
    std::vector<double> to_bow_mm;
    std::vector<bool> off_bow;
    Rigid3 bow_from_face;
  };
  struct Clutch {
    Rigid3 mandible_from_clutch, bow_from_clutch;
  };

  void build_surfaces();
  const ChainSurface* surface_of(const TriangleMesh& mesh) const {
    for (const auto& s : start_.surfaces)
      if (&s->mesh == &mesh) return s.get();
    return nullptr;
  }
  Rigid3& pose(int unknown) { return start_.problem.poses[static_cast<std::size_t>(unknown)]; }
  std::vector<SurfaceTerm>& terms() { return start_.problem.terms; }

  void add_clutch_terms(const ChainSurface& clutch, std::size_t index);
  Result<Clutch> find_clutch(const TriangleMesh& scan) const;
  Result<Face> find_bow(const TriangleMesh& scan, const std::string& name) const;
  Result<std::vector<Rigid3>> on_the_first(const std::vector<TriangleMesh>& scans, const std::string& name,
                                           std::uint64_t seed) const;
  Result<Rigid3> find_head_between(const Face& mi, const Face& tp, const Rigid3& guess) const;
  Result<Rigid3> find_head_frame() const;
  void add_face_terms(const Face& face, int head_from_face, int head_from_bow, const std::string& position);
  void add_head_term(const Face& face, int head_from_face, const std::string& name);
  void add_repeats(const std::vector<TriangleMesh>& scans, const std::vector<Rigid3>& on_first,
                   int first_unknown, int head_from_bow, const char* position);

  const ChainScans& scans_;
  std::uint64_t seed_;
  std::optional<TrackedPositions> tracked_;
  ChainStart start_;
  const ChainSurface *mandible_ = nullptr, *bow_ = nullptr, *head_frame_ = nullptr;
  Clutch first_clutch_;
  Face first_face_, first_face_tp_;
  std::vector<Rigid3> clutches_on_first_, faces_mi_on_first_, faces_tp_on_first_;
};

void Registrar::build_surfaces() {
  std::vector<std::pair<const TriangleMesh*, Role>> meshes;
  for (const TriangleMesh* model : {&scans_.mandible_mi, &scans_.bow_model, &scans_.head_frame_model})
    if (!model->empty()) meshes.emplace_back(model, Role::kTarget);
  const auto add = [&](const std::vector<TriangleMesh>& scans, Role first) {
    for (const TriangleMesh& scan : scans)
      meshes.emplace_back(&scan, &scan == &scans.front() ? first : Role::kSought);
  };
  add(scans_.clutch_scans, scans_.clutch_scans.size() > 1 ? Role::kTarget : Role::kSought);
  add(scans_.faces_mi, Role::kTarget);
  add(scans_.faces_tp, Role::kTarget);
  start_.surfaces.resize(meshes.size());
  tbb::parallel_for(std::size_t{0}, meshes.size(), [&](std::size_t i) {
    start_.surfaces[i] = std::make_unique<ChainSurface>(*meshes[i].first, meshes[i].second);
  });
}

Status Registrar::search_all() {
  using Poses = Result<std::vector<Rigid3>>;
  Result<Clutch> clutch;
  Result<Face> mi, tp;
  Poses clutches, faces_mi, faces_tp;
  const bool faces = !scans_.faces_mi.empty();
  tbb::parallel_invoke([&] { clutch = find_clutch(scans_.clutch_scans.front()); },
                       [&] {
                         if (faces) mi = find_bow(scans_.faces_mi.front(), "face scan in MI");
                       },
                       [&] {
                         if (faces) tp = find_bow(scans_.faces_tp.front(), "face scan in TP");
                       },
                       [&] { clutches = on_the_first(scans_.clutch_scans, "clutch scan {}", seed_); },
                       [&] { faces_mi = on_the_first(scans_.faces_mi, "face scan {} in MI", seed_ + 40); },
                       [&] { faces_tp = on_the_first(scans_.faces_tp, "face scan {} in TP", seed_ + 40); });
  GNATHION_TRY(first_clutch_, std::move(clutch));
  GNATHION_TRY(first_face_, std::move(mi));
  GNATHION_TRY(first_face_tp_, std::move(tp));
  GNATHION_TRY(clutches_on_first_, std::move(clutches));
  GNATHION_TRY(faces_mi_on_first_, std::move(faces_mi));
  GNATHION_TRY(faces_tp_on_first_, std::move(faces_tp));
  return {};
}

/// Further scans resemble the first of their kind in all parts.
Result<std::vector<Rigid3>> Registrar::on_the_first(const std::vector<TriangleMesh>& scans,
                                                    const std::string& name, std::uint64_t seed) const {
  if (scans.size() < 2) return std::vector<Rigid3>(scans.size());
  std::vector<Result<Rigid3>> found(scans.size());
  const ChainSurface& first = *surface_of(scans.front());
  tbb::parallel_for(std::size_t{1}, scans.size(), [&](std::size_t i) {
    found[i] = locate({&scans[i], all_of(scans[i])}, {&first.mesh, all_of(first.mesh)}, *first.query,
                      coarse(fmt::format(fmt::runtime(name), i + 1) + " on the first", 0.6, seed + i));
  });
  std::vector<Rigid3> first_from_scan;
  for (Result<Rigid3>& f : found) {
    GNATHION_TRY(first_from_scan.emplace_back(), std::move(f));
  }
  return first_from_scan;
}

Result<Registrar::Clutch> Registrar::find_clutch(const TriangleMesh& scan) const {
  Clutch clutch;
  GNATHION_TRY(clutch.mandible_from_clutch,
               locate({&scan, all_of(scan)}, {&mandible_->mesh, all_of(mandible_->mesh)}, *mandible_->query,
                      coarse("clutch scan on lower arch", 0.5, seed_)));
  const std::vector<bool> not_teeth =
      where(distances_to(scan, *mandible_->query, clutch.mandible_from_clutch, 5.0), 0.5, 5.0);
  GNATHION_TRY(clutch.bow_from_clutch, locate({&scan, not_teeth}, {&bow_->mesh, all_of(bow_->mesh)},
                                              *bow_->query, coarse("clutch scan on bow", 0.7, seed_)));
  return clutch;
}

/// T_D: each clutch scan's teeth on the lower arch, the rest of it on the bow.
void Registrar::add_clutch_scans() {
  const ChainUnknowns& u = start_.unknowns;
  const Clutch& first = first_clutch_;
  pose(u.t_d) = first.bow_from_clutch * first.mandible_from_clutch.inverse();
  for (std::size_t i = 0; i < scans_.clutch_scans.size(); ++i) {
    pose(u.first_clutch + static_cast<int>(i)) = first.bow_from_clutch * clutches_on_first_[i];
    add_clutch_terms(*surface_of(scans_.clutch_scans[i]), i);
  }
}

void Registrar::add_clutch_terms(const ChainSurface& clutch, std::size_t index) {
  const ChainUnknowns& u = start_.unknowns;
  const int unknown = u.first_clutch + static_cast<int>(index);
  const std::size_t count = scans_.clutch_scans.size();
  const Rigid3& on_bow = pose(unknown);
  const std::vector<double> off_teeth =
      distances_to(clutch.mesh, *mandible_->query, pose(u.t_d).inverse() * on_bow, 5.0);
  const std::vector<double> off_bow = distances_to(clutch.mesh, *bow_->query, on_bow, 5.0);
  std::vector<bool> teeth = where(off_teeth, 0.0, 0.4), bow_part = where(off_bow, 0.0, 0.4);
  for (std::size_t t = 0; t < teeth.size(); ++t) {
    // Where clutch and teeth meet, the nearer one has it, and what could be either has none.
    if (off_bow[t] < 0.6) teeth[t] = false;
    if (off_teeth[t] < 0.5) bow_part[t] = false;
  }
  SurfaceTerm on_arch = term_of(numbered("clutch scan", index, count) + " on lower arch", clutch, teeth,
                                kClutch, *mandible_, Onto::kScan, kTeethNoise, seed_ + 1);
  on_arch.left = u.t_d;
  on_arch.right = unknown;
  on_arch.surface_scanner = kIntraoral;
  // About the dental frame's own origin: the frame is that of the scan, upper arch and all.
  on_arch.surface_scale_centre_mm = Vector3::Zero();
  terms().push_back(std::move(on_arch));
  SurfaceTerm on_cad = term_of(numbered("clutch scan", index, count) + " on bow", clutch, bow_part, kClutch,
                               *bow_, Onto::kCad, kClutchNoise, seed_ + 2);
  on_cad.right = unknown;
  terms().push_back(std::move(on_cad));
}

/// The bow in a face scan, and what of the scan is not bow.
Result<Registrar::Face> Registrar::find_bow(const TriangleMesh& scan, const std::string& name) const {
  Face face;
  face.surface = surface_of(scan);
  GNATHION_TRY(const Rigid3 found, locate({&bow_->mesh, all_of(bow_->mesh)}, {&scan, all_of(scan)},
                                          *face.surface->query, coarse("bow in " + name, 0.4, seed_ + 10)));
  face.bow_from_face = found.inverse();
  face.to_bow_mm = distances_to(scan, *bow_->query, face.bow_from_face, kOffBow_mm);
  face.off_bow = where(face.to_bow_mm, kOffBow_mm, kOffBow_mm);
  return face;
}

/// All that is rigid in both scans and not bow. `guess`: the jaw has hardly moved.
Result<Rigid3> Registrar::find_head_between(const Face& mi, const Face& tp, const Rigid3& guess) const {
  const SearchSurface source{&tp.surface->mesh, tp.off_bow}, target{&mi.surface->mesh, mi.off_bow};
  if (const auto near = locate_near(source, target, *mi.surface->query, guess, seed_ + 30)) return *near;
  return locate(source, target, *mi.surface->query, coarse("head between face scans", 0.6, seed_ + 30));
}

/// head_from_face of the first face scan, by the head frame's model.
Result<Rigid3> Registrar::find_head_frame() const {
  const ChainSurface& mi = *first_face_.surface;
  GNATHION_TRY(const Rigid3 frame,
               locate({&head_frame_->mesh, all_of(head_frame_->mesh)}, {&mi.mesh, first_face_.off_bow},
                      *mi.query, coarse("head frame in face scan in MI", 0.4, seed_ + 31)));
  return frame.inverse();
}

/// Bow and head frame in one face scan whose poses are known roughly.
void Registrar::add_face_terms(const Face& face, int head_from_face, int head_from_bow,
                               const std::string& name) {
  const auto add = [&](const char* body, const ChainSurface& model, const std::vector<double>& to_body_mm) {
    SurfaceTerm term =
        term_of(fmt::format("{} in {}", body, name), *face.surface, where(to_body_mm, 0.0, kOnBow_mm), kFace,
                model, Onto::kCad, kFaceNoise, seed_ + 3);
    term.right = head_from_face;
    terms().push_back(std::move(term));
  };
  add("bow", *bow_, face.to_bow_mm);
  terms().back().left = head_from_bow;
  if (head_frame_ == nullptr) return;
  const std::vector<double> to_frame_mm =
      distances_to(face.surface->mesh, *head_frame_->query, pose(head_from_face), kOffBow_mm);
  add("head frame", *head_frame_, to_frame_mm);
}

/// The head of a face scan on that of the first, where no model of a head frame says better.
void Registrar::add_head_term(const Face& face, int head_from_face, const std::string& name) {
  SurfaceTerm head = term_of(name, *face.surface, face.off_bow, kFace, *first_face_.surface, Onto::kScan,
                             kSkinNoise, seed_ + 4);
  head.keep = first_face_.off_bow;
  head.surface_scanner = kFace;
  head.surface_scale_centre_mm = first_face_.surface->centre_mm;
  head.left = start_.unknowns.first_face_mi;
  head.right = head_from_face;
  head.scale_cap_mm = kRigidHead_mm;
  head.rigid = false;
  terms().push_back(std::move(head));
}

/// Further scans of one jaw position, on the first of it.
void Registrar::add_repeats(const std::vector<TriangleMesh>& scans, const std::vector<Rigid3>& on_first,
                            int first_unknown, int head_from_bow, const char* position) {
  for (std::size_t i = 1; i < scans.size(); ++i) {
    const std::string name = fmt::format("face scan {} in {}", i + 1, position);
    Face face;
    face.surface = surface_of(scans[i]);
    const int unknown = first_unknown + static_cast<int>(i);
    pose(unknown) = pose(first_unknown) * on_first[i];
    face.bow_from_face = pose(head_from_bow).inverse() * pose(unknown);
    face.to_bow_mm = distances_to(scans[i], *bow_->query, face.bow_from_face, kOffBow_mm);
    face.off_bow = where(face.to_bow_mm, kOffBow_mm, kOffBow_mm);
    add_face_terms(face, unknown, head_from_bow, name);
    if (head_frame_ == nullptr) add_head_term(face, unknown, "head of " + name);
  }
}

Status Registrar::add_face_scans() {
  const ChainUnknowns& u = start_.unknowns;
  const Face& tp = first_face_tp_;
  const Rigid3 &t_f = first_face_.bow_from_face, &t_f_tp = tp.bow_from_face;
  Result<Rigid3> between, frame;
  tbb::parallel_invoke([&] { between = find_head_between(first_face_, tp, t_f.inverse() * t_f_tp); },
                       [&] {
                         if (head_frame_ != nullptr) frame = find_head_frame();
                       });
  GNATHION_TRY(const Rigid3 face_mi_from_tp, std::move(between));
  GNATHION_TRY(Rigid3 head_from_face, std::move(frame));
  if (head_frame_ == nullptr && tracked_) head_from_face = tracked_->head_from_bow_mi.value.rigid * t_f;
  if (head_frame_ == nullptr && !tracked_)
    start_.problem.fixed[static_cast<std::size_t>(u.first_face_mi)] = true;
  pose(u.first_face_mi) = head_from_face;
  pose(u.first_face_tp) = head_from_face * face_mi_from_tp;
  pose(u.head_from_bow_mi) = pose(u.first_face_mi) * t_f.inverse();
  pose(u.head_from_bow_tp) = pose(u.first_face_tp) * t_f_tp.inverse();

  add_face_terms(first_face_, u.first_face_mi, u.head_from_bow_mi, "face scan in MI");
  add_face_terms(tp, u.first_face_tp, u.head_from_bow_tp, "face scan in TP");
  if (head_frame_ == nullptr) add_head_term(tp, u.first_face_tp, "head between face scans");
  add_repeats(scans_.faces_mi, faces_mi_on_first_, u.first_face_mi, u.head_from_bow_mi, "MI");
  add_repeats(scans_.faces_tp, faces_tp_on_first_, u.first_face_tp, u.head_from_bow_tp, "TP");
  if (tracked_) {
    start_.problem.known.push_back(
        {u.head_from_bow_mi, tracked_->head_from_bow_mi.value.rigid, tracked_->head_from_bow_mi.covariance});
    start_.problem.known.push_back(
        {u.head_from_bow_tp, tracked_->head_from_bow_tp.value.rigid, tracked_->head_from_bow_tp.covariance});
  }
  return {};
}

}  // namespace

ChainUnknowns unknowns_of(const ChainScans& scans) {
  ChainUnknowns u;
  u.count = u.first_clutch + static_cast<int>(scans.clutch_scans.size());
  if (scans.faces_mi.empty()) return u;
  u.first_face_mi = u.count;
  u.first_face_tp = u.first_face_mi + static_cast<int>(scans.faces_mi.size());
  u.head_from_bow_mi = u.first_face_tp + static_cast<int>(scans.faces_tp.size());
  u.head_from_bow_tp = u.head_from_bow_mi + 1;
  u.count = u.head_from_bow_tp + 1;
  return u;
}

Result<ChainStart> register_scans(const ChainScans& scans, const ChainOptions& options, Progress& progress) {
  progress.begin_step("teeth, clutch and bow in the scans", 0.5);
  Registrar registrar(scans, options);
  GNATHION_CHECK_OK(registrar.search_all());
  registrar.add_clutch_scans();
  if (!scans.faces_mi.empty()) {
    progress.begin_step("head in the face scans", 0.2);
    GNATHION_CHECK_OK(registrar.add_face_scans());
  }
  return registrar.done();
}

}  // namespace gnathion
