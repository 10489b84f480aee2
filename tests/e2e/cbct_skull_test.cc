// Real joints: the label map of a dental CBCT, the CT of a head, the meshes of a dry skull.
#include <gtest/gtest.h>
#include <zlib.h>

#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "anatomy/joint_space.h"
#include "anatomy/joints/joints.h"
#include "anatomy/volume/iso_surface.h"
#include "anatomy/volume/read_volume.h"
#include "anatomy/xray.h"
#include "core/file.h"
#include "core/mesh_io.h"
#include "pipeline/xray_job.h"
#include "rendering/grey_png.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

fs::path skull_folder() {
  const char* shared = std::getenv("GNATHION_SHARED");
  return fs::path(shared ? shared : "../shared") / "data/skull";
}

TEST(CbctSkull, CondylesOfALabelMap) {
  const fs::path file = skull_folder() / "cbct_mandible/patient_MAND_Seg_Or.nii.gz";
  if (!fs::exists(file)) GTEST_SKIP() << "skipped: no label map at " << file;
  SilentProgress silent;
  const auto read = read_volume(file, {}, silent);
  ASSERT_TRUE(read.has_value()) << read.error().line();
  const VoxelGrid& grid = read->volume.grid;
  EXPECT_EQ(grid.size, (std::array<int, 3>{768, 768, 576}));
  // Its sform is RAS with both horizontal axes turned: in LPS the first voxel is at −115.2 mm, and rows go to
  // the left.
  EXPECT_LT((grid.origin_mm - Vector3(-115.2, -115.2, -86.4)).norm(), 0.01);
  EXPECT_LT((grid.step_mm - Matrix3(Vector3(0.3, 0.3, 0.3).asDiagonal())).norm(), 1e-4);

  const auto mandible = surface_of_labels(read->volume, {1}, {}, "mandible");
  ASSERT_TRUE(mandible.has_value()) << mandible.error().line();
  const Box box = bounding_box(*mandible);
  const double middle = box.centre_mm().x();
  CondylarPoles poles[2];
  for (const Side side : {Side::kLeft, Side::kRight}) {
    // The back of the upper half: behind the coronoid process.
    Box where = box;
    (side == Side::kLeft ? where.min_mm : where.max_mm).x() = middle;
    where.min_mm.y() = box.max_mm.y() - 25.0;
    const auto condyle = surface_of_labels(read->volume, {1}, where, side_name(side));
    ASSERT_TRUE(condyle.has_value()) << condyle.error().line();
    const CondylarPoles p = condylar_poles(*condyle, side, Vector3::UnitZ(), Vector3::UnitX());
    const double width = (p.lateral_mm - p.medial_mm).norm();
    std::printf("%s: %zu triangles, head %.1f mm wide\n", side_name(side), condyle->triangles.size(), width);
    // Mediolateral width of condyles: 20 mm, 15 to 26 (Christiansen et al. 1987, CT of 18 joints).
    EXPECT_GT(width, 12.0);
    EXPECT_LT(width, 28.0);
    poles[static_cast<int>(side)] = p;
  }
  // The patient's left is at positive x, and the lateral poles lie outside.
  EXPECT_GT(poles[0].lateral_mm.x(), poles[0].medial_mm.x());
  EXPECT_LT(poles[1].lateral_mm.x(), poles[1].medial_mm.x());
  const double across = (poles[0].lateral_mm - poles[1].lateral_mm).norm();
  std::printf("%.1f mm between the lateral poles\n", across);
  EXPECT_GT(across, 95.0);
  EXPECT_LT(across, 140.0);

  EXPECT_FALSE(surface_of_labels(read->volume, {7}, {}, "nothing").has_value());
}

/// One file out of a tar.gz.
std::string file_in_archive(const fs::path& archive, const std::string& wanted) {
  const gzFile in = gzopen(archive.c_str(), "rb");
  if (in == nullptr) return {};
  std::string found;
  char header[512];
  while (gzread(in, header, 512) == 512 && header[0] != 0) {
    const std::string name(header, strnlen(header, 100));
    const auto size =
        static_cast<std::size_t>(std::strtoull(std::string(header + 124, 12).c_str(), nullptr, 8));
    std::string content((size + 511) / 512 * 512, 0);
    if (gzread(in, content.data(), static_cast<unsigned>(content.size())) < static_cast<int>(size)) break;
    content.resize(size);
    if (fs::path(name).filename() == wanted) found = std::move(content);
  }
  gzclose(in);
  return found;
}

/// CT of a head: 108 slices from below, rows from the back to the front.
std::optional<RegisteredVolume> head_ct() {
  const std::string bytes = file_in_archive(skull_folder() / "head_ct/Cranium.inv3", "matrix.dat");
  if (bytes.size() != 2ULL * 108 * 256 * 256) return {};
  RegisteredVolume out;
  Volume& v = out.file.volume;
  v.grid.size = {256, 256, 108};
  v.grid.step_mm = Vector3(0.95703125, -0.95703125, 1.5).asDiagonal();
  v.grid.origin_mm = {-122.0, 122.0, -81.0};
  v.voxels16.resize(bytes.size() / 2);
  std::memcpy(v.voxels16.data(), bytes.data(), bytes.size());
  return out;
}

/// What the mandible adds to a film, at a pixel.
double of_mandible(const XrayFilm& film, const XrayFilm& resting, int column, int row) {
  const auto at = static_cast<std::size_t>(row * film.size_px + column);
  return static_cast<double>(film.integral[at]) - static_cast<double>(resting.integral[at]);
}

TEST(CbctSkull, FilmsOfARealJoint) {
  const auto head = head_ct();
  if (!head) GTEST_SKIP() << "skipped: no CT of a head below " << skull_folder();
  const VoxelGrid& grid = head->file.volume.grid;
  // Seeds on the head of the condyle and on the roof of its fossa, picked in the slices.
  JointRegion region;
  region.condyle_seed_mm = grid.frame_from_voxel({81, 130, 18});
  region.fossa_seed_mm = grid.frame_from_voxel({85, 130, 24});
  region.box_mm.extend(*region.condyle_seed_mm - Vector3(17, 17, 20));
  region.box_mm.extend(*region.condyle_seed_mm + Vector3(17, 17, 17));
  const TissueLevels levels = tissue_levels(head->file.volume);
  std::printf("air %.0f, soft tissue %.0f, bone above %.0f\n", levels.air.value_or(NAN), levels.soft,
              levels.bone);
  const auto found = find_joint(head->file.volume, levels.bone, region, "right joint");
  ASSERT_TRUE(found) << found.error().line();
  Joints joints;
  joints.right.emplace();
  joints.right->side = Side::kRight;
  joints.right->condyle = found->condyle;
  joints.right->fossa = found->fossa;
  const CondylarPoles poles =
      condylar_poles(found->condyle, Side::kRight, Vector3::UnitZ(), Vector3::UnitX());
  joints.right->medial_pole_mm = poles.medial_mm;
  joints.right->lateral_pole_mm = poles.lateral_mm;
  const double width_mm = (poles.lateral_mm - poles.medial_mm).norm();
  const double space_mm = JointQuery(*joints.right, Vector3::UnitZ()).in_mi().min_mm;
  std::printf("head %.1f mm wide, joint space %.2f mm%s\n", width_mm, space_mm,
              found->bridged ? ", bridged" : "");
  EXPECT_GT(width_mm, 12.0);
  EXPECT_LT(width_mm, 28.0);
  EXPECT_GT(space_mm, 0.0);
  EXPECT_LT(space_mm, 4.0);

  std::vector<std::string> notes;
  const XrayOptions options = scaled_to(head->file.volume, {}, &notes);
  EXPECT_TRUE(notes.empty()) << notes[0];
  CbctOptions cbct;
  const auto moving = moving_joints(*head, joints, cbct, options.field_mm, &notes);
  ASSERT_TRUE(moving) << moving.error().line();
  ArchFrame arch;
  for (const char* name : {"lateral", "frontal"}) {
    const auto view = named_view(name, arch);
    const auto xray = JointXray::create(head->file.volume, head->cbct_from_dental, moving->front().mandible,
                                        moving->front().centre_mm, *view, options);
    ASSERT_TRUE(xray) << xray.error().line();
    const XrayFilm mi = xray->film({}), scanned = xray->scanned();
    double worst = 0.0;
    for (std::size_t i = 0; i < mi.integral.size(); ++i)
      worst = std::max(worst, std::abs(static_cast<double>(mi.integral[i] - scanned.integral[i])));
    EXPECT_LT(worst, 1e-3) << "the mandible and the rest of the head are the head";
    // Whole pixels, so that the mandible's part of the film must be the same, only elsewhere.
    const double pitch = options.field_mm / options.size_px;
    const Vector3 step = pitch * Vector3(2, -13, -9);
    const XrayFilm opened = xray->film(Motion<Dental>(Rigid3::from_translation(step)));
    const int right_px = static_cast<int>(std::lround(view->right.dot(step) / pitch)),
              down_px = static_cast<int>(std::lround(-view->up.dot(step) / pitch));
    double off = 0.0, off_unmoved = 0.0, all = 0.0;
    for (int row = 64; row < 192; ++row)
      for (int column = 64; column < 192; ++column) {
        const double in_mi = of_mandible(mi, xray->resting(), column, row);
        all += std::abs(in_mi);
        off += std::abs(of_mandible(opened, xray->resting(), column + right_px, row + down_px) - in_mi);
        off_unmoved += std::abs(of_mandible(opened, xray->resting(), column, row) - in_mi);
      }
    std::printf(
        "%s: MI differs from the scan by %.1e of attenuation; moved by %d, %d pixels the mandible "
        "differs by %.2f %%, unmoved by %.0f %%\n",
        name, worst, right_px, down_px, 100.0 * off / all, 100.0 * off_unmoved / all);
    EXPECT_LT(off, 0.02 * all);
    EXPECT_GT(off_unmoved, 0.2 * all);
    if (const char* folder = std::getenv("GNATHION_PICTURES"))
      for (const auto& [which, film] : {std::pair("mi", &mi), std::pair("opened", &opened)}) {
        const XrayWindow w = window_of(mi);
        const auto png = png_bytes(windowed(*film, w.low, w.high));
        ASSERT_TRUE(png && write_file(fs::path(folder) / (std::string(name) + "_" + which + ".png"), *png));
      }
  }
}

/// Triangles with a corner in the box.
TriangleMesh within(const TriangleMesh& mesh, const Box& box) {
  TriangleMesh out;
  out.vertices_mm = mesh.vertices_mm;
  for (const auto& t : mesh.triangles) {
    const Vector3& p = mesh.vertices_mm[t[0]];
    if ((p - box.min_mm).minCoeff() >= 0.0 && (box.max_mm - p).minCoeff() >= 0.0) out.triangles.push_back(t);
  }
  return out;
}

TEST(CbctSkull, JointsOfADirtyMeshOfADrySkull) {
  const auto skull = read_mesh(skull_folder() / "dry_skull/Skull.obj"),
             mandible = read_mesh(skull_folder() / "dry_skull/Mandible.obj");
  if (!skull || !mandible) GTEST_SKIP() << "skipped: no dry skull below " << skull_folder();
  for (const bool high_x : {true, false}) {  // z up, y to the front
    Vector3 top(0, 0, -1e9);
    for (const Vector3& v : mandible->vertices_mm)
      if ((v.x() > -128.0) == high_x && v.z() > top.z()) top = v;
    Box box;
    box.extend(top - Vector3(15, 15, 12));
    box.extend(top + Vector3(15, 15, 12));
    Joint joint;
    joint.condyle = within(*mandible, box);
    joint.fossa = within(*skull, box);
    ASSERT_FALSE(joint.condyle.triangles.empty() || joint.fossa.triangles.empty());
    const JointQuery query(joint, Vector3::UnitZ());
    const double in_mi = query.in_mi().min_mm;
    const double down = query.at(Rigid3::from_translation({0, 0, -2})).min_mm;
    std::printf("dry joint at x %.0f: %.2f mm, lowered by 2 mm: %.2f mm\n", top.x(), in_mi, down);
    EXPECT_GT(in_mi, -1.0);
    EXPECT_LT(in_mi, 6.0);
    EXPECT_GT(down, in_mi);
  }
}

}  // namespace
}  // namespace gnathion
