// DICOM series, NIfTI and NRRD as volumes: where each voxel lies, what it holds, and what is refused.
//
// Volumes here hold a linear function of the place in the patient. Wrong order, axis, sign, scale or shear of
// any reader shows in it, and trilinear interpolation must give it back exactly.
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <zlib.h>

#include <cstring>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

#include "anatomy/volume/dicom_file.h"
#include "core/file.h"
#include "core/random.h"
#include "phantom/cbct_dicom.h"
#include "pipeline/cbct_steps.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
SilentProgress silent;

double truth(const Vector3& p_lps_mm) {
  return 20.0 + 3.0 * p_lps_mm.x() - 5.0 * p_lps_mm.y() + 2.0 * p_lps_mm.z();
}

class Folder {
 public:
  Folder() {
    path_ = fs::temp_directory_path() / fmt::format("gnathion_cbct_{}_{}", getpid(), count_++);
    fs::create_directories(path_);
  }
  ~Folder() { fs::remove_all(path_); }
  const fs::path& path() const { return path_; }
  void put(const std::string& name, const std::string& bytes) const {
    ASSERT_TRUE(write_file(path_ / name, bytes).has_value());
  }

 private:
  static inline int count_ = 0;
  fs::path path_;
};

/// A slice at step k of a series that leans by `tilt_deg` and stands anywhere in space.
DicomSliceSpec slice_at(int k, double tilt_deg = 0.0, double spacing_mm = 0.5) {
  DicomSliceSpec s;
  s.rows = 16, s.columns = 20;
  s.row_spacing_mm = 0.4, s.column_spacing_mm = 0.3, s.thickness_mm = spacing_mm;
  const Matrix3 turn = exp_so3({0.1, -0.2, 0.3});
  const double a = tilt_deg * M_PI / 180.0;
  s.along_row = turn * Vector3(1, 0, 0);
  s.along_column = turn * Vector3(0, std::cos(a), std::sin(a));
  s.position_mm = Vector3(4, -7, 11) + turn * Vector3(0, 0, k * spacing_mm);  // the table moves along z
  s.tilt_deg = tilt_deg;
  s.instance_number = 1000 - k;  // against the order in space
  s.instance_uid = fmt::format("{}.{}", s.series_uid, k + 1);
  s.slope = 0.01, s.intercept = -50.0;
  for (int j = 0; j < s.rows; ++j)
    for (int i = 0; i < s.columns; ++i) {
      const Vector3 p =
          s.position_mm + s.along_row * (i * s.column_spacing_mm) + s.along_column * (j * s.row_spacing_mm);
      s.stored.push_back(static_cast<std::int16_t>(std::lround((truth(p) - s.intercept) / s.slope)));
    }
  return s;
}

std::string scrambled_name(int k) {
  return fmt::format("I{:03}.dcm", (k * 7919 + 13) % 997);
}

Result<VolumeFile> read(const fs::path& path, const std::string& series = "") {
  ReadVolumeOptions options;
  options.series = series;
  return read_volume(path, options, silent);
}

void expect_linear(const Volume& v, double tolerance) {
  Random random(5);
  for (int n = 0; n < 200; ++n) {
    const Vector3 ijk(random.uniform(0, v.grid.size[0] - 1), random.uniform(0, v.grid.size[1] - 1),
                      random.uniform(0, v.grid.size[2] - 1));
    const Vector3 p = v.grid.frame_from_voxel(ijk);
    ASSERT_NEAR(v.at(p, NAN), truth(p), tolerance) << p.transpose();
  }
}

bool mentions(const std::vector<std::string>& warnings, const std::string& what) {
  for (const std::string& w : warnings)
    if (w.find(what) != std::string::npos) return true;
  return false;
}

void expect_refused(const Result<VolumeFile>& r, const std::string& why) {
  ASSERT_FALSE(r.has_value());
  EXPECT_EQ(r.error().code, ErrorCode::kInput);
  EXPECT_NE(r.error().line().find(why), std::string::npos) << r.error().line();
}

void put_series(const Folder& folder, int first, int last, double tilt_deg = 0.0, double spacing_mm = 0.5) {
  for (int k = first; k < last; ++k)
    folder.put(scrambled_name(k), format_dicom_slice(slice_at(k, tilt_deg, spacing_mm)));
}

TEST(DicomSeries, IsSortedBySpaceNotByNameOrNumber) {
  Folder folder;
  put_series(folder, 0, 24);
  const auto v = read(folder.path());
  ASSERT_TRUE(v.has_value()) << v.error().line();
  EXPECT_EQ(v->volume.grid.size, (std::array<int, 3>{20, 16, 24}));
  EXPECT_TRUE(v->volume.grid.spacing_mm().isApprox(Vector3(0.3, 0.4, 0.5), 1e-6));
  EXPECT_GT(v->volume.grid.step_mm.determinant(), 0.0);
  expect_linear(v->volume, 0.02);
  EXPECT_TRUE(mentions(v->info.warnings, "not cubes: 0.3 x 0.4 x 0.5"));
  EXPECT_EQ(v->volume.voxels16.size(), v->volume.grid.count());  // 16 bits stay 16 bits
  // One file of it stands for the series.
  const auto by_file = read(folder.path() / scrambled_name(3));
  ASSERT_TRUE(by_file.has_value()) << by_file.error().line();
  EXPECT_EQ(by_file->volume.voxels16, v->volume.voxels16);
}

TEST(DicomSeries, GantryTiltIsASheardGrid) {
  for (const double tilt : {12.0, -25.0}) {
    Folder folder;
    put_series(folder, 0, 20, tilt);
    const auto v = read(folder.path());
    ASSERT_TRUE(v.has_value()) << v.error().line();
    EXPECT_NEAR(v->info.gantry_tilt_deg, std::abs(tilt), 0.01);
    EXPECT_TRUE(mentions(v->info.warnings, "gantry tilt"));
    expect_linear(v->volume, 0.02);
  }
  Folder told_only;  // a tag without positions that lean
  for (int k = 0; k < 10; ++k) {
    DicomSliceSpec s = slice_at(k);
    s.tilt_deg = 9.0;
    told_only.put(scrambled_name(k), format_dicom_slice(s));
  }
  const auto v = read(told_only.path());
  ASSERT_TRUE(v.has_value());
  EXPECT_TRUE(mentions(v->info.warnings, "9.0 degrees of gantry tilt, the slices' positions of none"));
}

TEST(DicomSeries, OneMissingSliceIsFilledAndNamedMoreAreRefused) {
  Folder one;
  put_series(one, 0, 9);
  put_series(one, 10, 24);
  const auto v = read(one.path());
  ASSERT_TRUE(v.has_value()) << v.error().line();
  EXPECT_EQ(v->volume.grid.size[2], 24);
  EXPECT_TRUE(mentions(v->info.warnings, "missing slices"));
  EXPECT_TRUE(mentions(v->info.warnings, scrambled_name(8)) &&
              mentions(v->info.warnings, scrambled_name(10)));
  expect_linear(v->volume, 0.02);  // a linear function is filled exactly
  Folder two;
  put_series(two, 0, 9);
  put_series(two, 11, 24);
  expect_refused(read(two.path()),
                 "2 slices are missing: 2 between " + scrambled_name(8) + " and " + scrambled_name(11));
  Folder uneven;
  put_series(uneven, 0, 9);
  DicomSliceSpec late = slice_at(9);
  late.position_mm += 0.3 * (slice_at(10).position_mm - slice_at(9).position_mm);
  uneven.put("late.dcm", format_dicom_slice(late));
  expect_refused(read(uneven.path()), "uneven slices");
  Folder beside;
  put_series(beside, 0, 9);
  DicomSliceSpec moved = slice_at(9);
  moved.position_mm += 2.0 * moved.along_row;
  beside.put("moved.dcm", format_dicom_slice(moved));
  expect_refused(read(beside.path()), "out of line");
}

TEST(DicomSeries, DuplicatesAreLeftOutOnlyIfEqual) {
  Folder folder;
  put_series(folder, 0, 12);
  DicomSliceSpec twin = slice_at(5);
  twin.instance_uid += ".2";
  folder.put("twin.dcm", format_dicom_slice(twin));
  const auto v = read(folder.path());
  ASSERT_TRUE(v.has_value()) << v.error().line();
  EXPECT_TRUE(mentions(v->info.warnings, "same slice twice") && mentions(v->info.warnings, "twin.dcm"));
  EXPECT_EQ(v->volume.grid.size[2], 12);
  twin.stored[40] = static_cast<std::int16_t>(twin.stored[40] + 30);
  folder.put("twin.dcm", format_dicom_slice(twin));
  expect_refused(read(folder.path()), "two different slices at one place");
}

TEST(DicomSeries, WarningsNameNoPatientThoughFilesDo) {
  Folder folder;
  put_series(folder, 0, 12);
  DicomSliceSpec twin = slice_at(5);
  twin.instance_uid += ".2";
  folder.put("Phantom_One_0005.dcm", format_dicom_slice(twin));
  const auto v = read(folder.path());
  ASSERT_TRUE(v.has_value()) << v.error().line();
  EXPECT_TRUE(mentions(v->info.warnings, "***_***_0005.dcm"));
}

TEST(DicomSeries, SeveralInOneFolderAreListedAndChosen) {
  Folder folder;
  put_series(folder, 0, 8);
  for (int k = 0; k < 11; ++k) {
    DicomSliceSpec s = slice_at(k);
    s.series_uid = "1.2.3.4", s.series_number = "7", s.description = "second";
    folder.put(fmt::format("b{}.dcm", k), format_dicom_slice(s));
  }
  folder.put("readme.txt", "no picture");
  expect_refused(read(folder.path()), "several series, choose one with --series: #1 'phantom' (CT, 8 files");
  for (const char* name : {"7", "1.2.3.4", "#2"}) {
    const auto v = read(folder.path(), name);
    ASSERT_TRUE(v.has_value()) << v.error().line();
    EXPECT_EQ(v->volume.grid.size[2], 11);
    EXPECT_EQ(v->info.description, "second");
  }
  expect_refused(read(folder.path(), "8"), "no series are '8'");
  const auto list = list_volumes(folder.path());
  ASSERT_TRUE(list.has_value());
  ASSERT_EQ(list->size(), 2u);
  EXPECT_EQ((*list)[0].grid.size[2], 8);
  EXPECT_EQ((*list)[1].series_uid, "1.2.3.4");
  EXPECT_TRUE(mentions((*list)[0].warnings, "1 files in the folder are not DICOM"));
}

TEST(DicomSeries, LocalizersAreLeftOutByName) {
  Folder folder;
  put_series(folder, 0, 12);
  DicomSliceSpec across = slice_at(3);  // same series, seen from the side
  across.along_column = across.along_row.cross(across.along_column);
  folder.put("side.dcm", format_dicom_slice(across));
  DicomSliceSpec scout = slice_at(20);
  scout.image_type = "ORIGINAL\\PRIMARY\\LOCALIZER";
  folder.put("scout.dcm", format_dicom_slice(scout));
  const auto v = read(folder.path());
  ASSERT_TRUE(v.has_value()) << v.error().line();
  EXPECT_EQ(v->volume.grid.size[2], 12);
  EXPECT_TRUE(mentions(v->info.warnings, "side.dcm"));
  EXPECT_TRUE(mentions(v->info.warnings, "a localizer: scout.dcm"));
  expect_linear(v->volume, 0.02);
  Folder only;
  only.put("scout.dcm", format_dicom_slice(scout));
  expect_refused(read(only.path()), "localizers only");
}

TEST(DicomSeries, PhotographsAndOtherUnitsAreRefused) {
  Folder photo;
  DicomSliceSpec s = slice_at(0);
  s.placed = false;
  photo.put("photo.dcm", format_dicom_slice(s));
  expect_refused(read(photo.path()), "a photograph or secondary capture");
  Folder metres;
  for (int k = 0; k < 10; ++k) {
    DicomSliceSpec m = slice_at(k);
    m.position_mm *= 0.001, m.row_spacing_mm *= 0.001, m.column_spacing_mm *= 0.001;
    // 0.00x mm between slices would count as one place: keep them apart as metres would.
    m.position_mm += m.along_row.cross(m.along_column) * (0.02 * k);
    metres.put(scrambled_name(k), format_dicom_slice(m));
  }
  expect_refused(read(metres.path()), "metres?");
}

TEST(DicomSeries, DamageIsNamed) {
  const std::string whole = format_dicom_slice(slice_at(4));
  Folder cut;
  put_series(cut, 0, 4);
  put_series(cut, 5, 12);
  cut.put("cut.dcm", whole.substr(0, whole.size() - 200));
  const auto v = read(cut.path());  // one slice: filled, and both things are said
  ASSERT_TRUE(v.has_value()) << v.error().line();
  EXPECT_TRUE(
      mentions(v->info.warnings, "left out, unreadable: cut.dcm (truncated: its pixels take 640 bytes, 440"));
  EXPECT_TRUE(mentions(v->info.warnings, "missing slices"));
  Folder all;
  all.put("cut.dcm", whole.substr(0, whole.size() - 200));
  expect_refused(read(all.path()), "truncated: its pixels");
  for (const int rows : {32, 8}) {  // pixels that are not as many as the header says
    DicomSliceSpec lie = slice_at(0);
    lie.rows = rows;
    expect_refused(parse_dicom(format_dicom_slice(lie), "lie.dcm"),
                   rows > 16 ? "truncated: 20 x 32 x 1" : "its header lies: 20 x 8 x 1");
  }
  Folder encrypted;
  put_series(encrypted, 0, 6);
  encrypted.put("locked.dcm",
                std::string("\x30\x82\x10\x00\x06\x09\x2a\x86\x48\x86\xf7\x0d\x01\x07\x03", 15) +
                    std::string(500, 'x'));
  expect_refused(read(encrypted.path()), "locked.dcm: encrypted");
  Folder empty;
  expect_refused(read(empty.path()), "no DICOM files");
  expect_refused(read(empty.path() / "none"), "no such file");
}

TEST(DicomSeries, ScalesAndSignsOfTheirOwn) {
  Folder folder;  // each slice with its own slope, as PET and some CBCT write it
  for (int k = 0; k < 10; ++k) {
    DicomSliceSpec s = slice_at(k);
    const double slope = 0.01 + 0.001 * k;
    for (std::int16_t& x : s.stored) x = static_cast<std::int16_t>(std::lround(x * 0.01 / slope));
    s.slope = slope;
    folder.put(scrambled_name(k), format_dicom_slice(s));
  }
  const auto v = read(folder.path());
  ASSERT_TRUE(v.has_value()) << v.error().line();
  expect_linear(v->volume, 0.03);
  DicomSliceSpec high = slice_at(0);  // unsigned values beyond 32767
  high.is_signed = false, high.slope = 1.0, high.intercept = -1000.0;
  for (std::size_t i = 0; i < high.stored.size(); ++i)
    high.stored[i] = static_cast<std::int16_t>(static_cast<std::uint16_t>(200 * i));
  const auto u = parse_dicom(format_dicom_slice(high), "high.dcm");
  ASSERT_TRUE(u.has_value()) << u.error().line();
  for (std::size_t i = 0; i < high.stored.size(); ++i)
    ASSERT_EQ(u->volume.value(i), 200.0 * static_cast<double>(i) - 1000.0);
}

TEST(DicomSeries, NamesStayInUnlessAsked) {
  Folder folder;
  put_series(folder, 0, 6);
  const auto list = list_volumes(folder.path());
  ASSERT_TRUE(list.has_value());
  EXPECT_EQ(volume_info_json((*list)[0], false).dump().find("PHANTOM"), std::string::npos);
  EXPECT_NE(volume_info_json((*list)[0], true).dump().find("PHANTOM^ONE"), std::string::npos);
}

// ---- Files of others.

fs::path dicom_folder() {
  const char* folder = std::getenv("GNATHION_SHARED");
  return fs::path(folder ? folder : "../shared") / "data" / "dicom";
}

std::int64_t sum_of(const std::vector<std::int16_t>& values, int offset) {
  std::int64_t sum = 0;
  for (const std::int16_t v : values) sum += v + offset;
  return sum;
}

/// Mean difference of neighbours against that of voxels far apart: noise and garbage have 1.
double roughness(const std::vector<std::int16_t>& v) {
  double near = 0.0, far = 0.0;
  const std::size_t away = v.size() / 3;
  for (std::size_t i = 1; i + away < v.size(); ++i) {
    near += std::abs(v[i] - v[i - 1]);
    far += std::abs(v[i + away] - v[i]);
  }
  return near / std::max(1.0, far);
}

TEST(DicomFiles, EveryTransferSyntaxIsDecoded) {
  if (!fs::exists(dicom_folder())) GTEST_SKIP() << "skipped: no files at " << dicom_folder();
  struct Known {
    const char *file, *syntax;
    int columns, rows;
    std::size_t planes;
    std::int64_t
        sum;  ///< of all stored values, as Python's array, zlib and a run-length loop give it; 0: none
  };
  const Known files[] = {{"deflated.dcm", "deflated", 512, 512, 1, 33322688},
                         {"explicit_big.dcm", "explicit big endian", 256, 256, 1, 12795755},
                         {"explicit_little.dcm", "explicit little endian", 256, 256, 16, 33832036},
                         {"implicit_little.dcm", "implicit little endian", 256, 256, 1, 4294431},
                         {"jpeg_2000.dcm", "JPEG 2000", 512, 512, 1, 0},
                         {"jpeg_baseline_8bit.dcm", "JPEG baseline", 512, 512, 96, 0},
                         {"jpeg_lossless_sel1.dcm", "JPEG lossless", 512, 400, 1, 0},
                         {"jpeg_ls.dcm", "JPEG-LS near lossless", 1024, 1024, 1, 0},
                         {"rle.dcm", "RLE", 512, 512, 1, 40028413}};
  std::map<std::string, std::vector<std::int16_t>> decoded;
  for (const Known& known : files) {
    SCOPED_TRACE(known.file);
    const auto bytes = read_file(dicom_folder() / "transfer-syntaxes" / known.file);
    ASSERT_TRUE(bytes.has_value());
    ASSERT_TRUE(check_dicom_structure(*bytes, known.file).has_value());
    const auto header = parse_dicom_header(*bytes, known.file);
    ASSERT_TRUE(header.has_value()) << header.error().line();
    EXPECT_EQ(transfer_syntax_name(header->transfer_syntax), known.syntax);
    EXPECT_EQ(header->columns, known.columns);
    EXPECT_EQ(header->rows, known.rows);
    EXPECT_EQ(header->planes.size(), known.planes);
    const auto pixels = decode_dicom_pixels(*bytes, *header);
    ASSERT_TRUE(pixels.has_value()) << pixels.error().line();
    if (known.sum != 0) EXPECT_EQ(sum_of(pixels->values, pixels->offset), known.sum);
    EXPECT_LT(roughness(pixels->values), 0.5);
    decoded[known.file] = pixels->values;
    // Cut anywhere, it is refused.
    for (const double share : {0.3, 0.7, 0.98}) {
      const std::string part =
          bytes->substr(0, static_cast<std::size_t>(share * static_cast<double>(bytes->size())));
      EXPECT_FALSE(parse_dicom(part, known.file).has_value()) << share;
    }
  }
  // The same picture, packed with and without loss.
  const auto &with = decoded["jpeg_2000.dcm"], &without = decoded["rle.dcm"];
  double squares = 0.0;
  for (std::size_t i = 0; i < with.size(); ++i) squares += std::pow(with[i] - without[i], 2);
  EXPECT_LT(std::sqrt(squares / static_cast<double>(with.size())), 60.0);
}

TEST(DicomFiles, ARealSeriesAndWhatIsNoVolume) {
  if (!fs::exists(dicom_folder())) GTEST_SKIP() << "skipped: no files at " << dicom_folder();
  const auto mr = read(dicom_folder() / "mr-series");
  ASSERT_TRUE(mr.has_value()) << mr.error().line();
  EXPECT_EQ(mr->volume.grid.size, (std::array<int, 3>{256, 256, 20}));
  EXPECT_TRUE(mentions(mr->info.warnings, "modality MR"));
  EXPECT_TRUE(mentions(mr->info.warnings, "coarse for a joint space"));
  const fs::path files = dicom_folder() / "transfer-syntaxes";
  const auto parse = [&](const char* name) { return parse_dicom(*read_file(files / name), name); };
  expect_refused(parse("jpeg_lossless_sel1.dcm"), "localizer");
  expect_refused(parse("jpeg_baseline_8bit.dcm"), "a photograph or secondary capture");
  expect_refused(parse("deflated.dcm"), "a photograph or secondary capture");
  const auto ct = parse_dicom(*read_file(dicom_folder() / "CT_small.dcm"), "CT_small.dcm");
  ASSERT_TRUE(ct.has_value()) << ct.error().line();
  EXPECT_EQ(ct->volume.value(0), 175.0 - 1024.0);  // its first pixel and its rescale
}

// ---- NIfTI and NRRD.

template <class T>
void put_at(std::string& bytes, std::size_t at, T value, bool big) {
  char raw[sizeof(T)];
  std::memcpy(raw, &value, sizeof(T));
  if (big) std::reverse(raw, raw + sizeof(T));
  bytes.replace(at, sizeof(T), raw, sizeof(T));
}

/// Values of the linear function on a grid (LPS), through slope 0.01.
template <class T>
std::string voxels_of(const VoxelGrid& g, bool big, double slope) {
  std::string out(g.count() * sizeof(T), '\0');
  std::size_t at = 0;
  for (int k = 0; k < g.size[2]; ++k)
    for (int j = 0; j < g.size[1]; ++j)
      for (int i = 0; i < g.size[0]; ++i, at += sizeof(T)) {
        const double v = truth(g.frame_from_voxel(Vector3(i, j, k))) / slope;
        put_at(out, at, std::is_floating_point_v<T> ? static_cast<T>(v) : static_cast<T>(std::lround(v)),
               big);
      }
  return out;
}

VoxelGrid skew_grid() {
  VoxelGrid g;
  g.size = {14, 11, 9};
  g.step_mm = exp_so3({0.3, 0.5, -0.4}) * Vector3(0.5, 0.7, 0.9).asDiagonal();
  g.step_mm.col(0) *= -1.0;  // left-handed, as most NIfTI
  g.origin_mm = {-3, 8, 15};
  return g;
}

std::string gzipped(const std::string& bytes) {
  z_stream z{};
  deflateInit2(&z, 6, Z_DEFLATED, 15 + 16, 8, Z_DEFAULT_STRATEGY);
  std::string out(bytes.size() + 1000, '\0');
  z.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
  z.avail_in = static_cast<uInt>(bytes.size());
  z.next_out = reinterpret_cast<Bytef*>(out.data());
  z.avail_out = static_cast<uInt>(out.size());
  deflate(&z, Z_FINISH);
  out.resize(z.total_out);
  deflateEnd(&z);
  return out;
}

enum class Form { kS, kQ, kNone };
template <class T>
std::string nifti(const VoxelGrid& lps, Form form, int type, bool big, double unit_mm = 1.0, char units = 2) {
  VoxelGrid ras = lps;
  ras.step_mm.topRows<2>() *= -1.0;
  ras.origin_mm.head<2>() *= -1.0;
  std::string h(352, '\0');
  const auto f = [&](std::size_t at, double v) { put_at(h, at, static_cast<float>(v), big); };
  put_at(h, 0, std::int32_t{348}, big);
  put_at(h, 40, std::int16_t{3}, big);
  for (std::size_t a = 0; a < 3; ++a) put_at(h, 42 + 2 * a, static_cast<std::int16_t>(lps.size[a]), big);
  put_at(h, 70, static_cast<std::int16_t>(type), big);
  const Vector3 spacing = ras.spacing_mm() / unit_mm;
  const double qfac = ras.step_mm.determinant() < 0.0 ? -1.0 : 1.0;
  f(76, qfac);
  for (int a = 0; a < 3; ++a) f(80 + 4 * static_cast<std::size_t>(a), spacing[a]);
  f(108, 352), f(112, 0.01), f(116, 0.0);
  h[123] = units;
  put_at(h, 252, static_cast<std::int16_t>(form == Form::kQ), big);
  put_at(h, 254, static_cast<std::int16_t>(form == Form::kS), big);
  Matrix3 r = ras.step_mm * ras.spacing_mm().cwiseInverse().asDiagonal();
  r.col(2) *= qfac;
  Eigen::Quaterniond q(r);
  if (q.w() < 0.0) q.coeffs() *= -1.0;
  f(256, q.x()), f(260, q.y()), f(264, q.z());
  for (int a = 0; a < 3; ++a) f(268 + 4 * static_cast<std::size_t>(a), ras.origin_mm[a] / unit_mm);
  for (int row = 0; row < 3; ++row) {
    for (int c = 0; c < 3; ++c)
      f(280 + 16 * static_cast<std::size_t>(row) + 4 * static_cast<std::size_t>(c),
        ras.step_mm(row, c) / unit_mm);
    f(292 + 16 * static_cast<std::size_t>(row), ras.origin_mm[row] / unit_mm);
  }
  h.replace(344, 3, "n+1");
  return h + voxels_of<T>(lps, big, 0.01);
}

TEST(Nifti, GeometryOfBothFormsTypesAndByteOrders) {
  const VoxelGrid g = skew_grid();
  for (const bool big : {false, true})
    for (const Form form : {Form::kS, Form::kQ}) {
      const auto v = parse_nifti(nifti<std::int16_t>(g, form, 4, big), "a.nii");
      ASSERT_TRUE(v.has_value()) << v.error().line();
      EXPECT_TRUE(v->volume.grid.step_mm.isApprox(g.step_mm, 1e-5)) << v->volume.grid.step_mm;
      expect_linear(v->volume, 0.02);
      const auto packed = parse_nifti(gzipped(nifti<std::int32_t>(g, form, 8, big)), "a.nii.gz");
      ASSERT_TRUE(packed.has_value()) << packed.error().line();
      expect_linear(packed->volume, 0.02);
      const auto real = parse_nifti(nifti<double>(g, form, 64, big), "a.nii");
      ASSERT_TRUE(real.has_value()) << real.error().line();
      expect_linear(real->volume, 0.02);
      EXPECT_FALSE(real->volume.voxels.empty());
    }
  const auto none = parse_nifti(nifti<std::int16_t>(g, Form::kNone, 4, false), "a.nii");
  ASSERT_TRUE(none.has_value());
  EXPECT_TRUE(mentions(none->info.warnings, "neither sform nor qform"));
}

TEST(Nifti, UnitsDamageAndOthersAreNamed) {
  const VoxelGrid g = skew_grid();
  const auto metres = parse_nifti(nifti<std::int16_t>(g, Form::kS, 4, false, 1000.0, 1), "m.nii");
  ASSERT_TRUE(metres.has_value()) << metres.error().line();
  EXPECT_TRUE(mentions(metres->info.warnings, "units in metres"));
  expect_linear(metres->volume, 0.02);
  expect_refused(parse_nifti(nifti<std::int16_t>(g, Form::kS, 4, false, 1000.0, 2), "m.nii"), "metres?");
  const std::string good = nifti<std::int16_t>(g, Form::kS, 4, false), packed = gzipped(good);
  expect_refused(parse_nifti(good.substr(0, good.size() - 1), "a.nii"), "truncated");
  expect_refused(parse_nifti(good.substr(0, 200), "a.nii"), "truncated");
  expect_refused(parse_nifti(packed.substr(0, packed.size() / 2), "a.nii.gz"), "truncated");
  std::string huge = good;
  for (std::size_t a = 0; a < 3; ++a) put_at(huge, 42 + 2 * a, std::int16_t{30000}, false);
  expect_refused(parse_nifti(huge, "a.nii"), "allowed");
  std::string flat = good;
  for (std::size_t b = 280; b < 296; ++b) flat[b] = '\0';
  expect_refused(parse_nifti(flat, "a.nii"), "singular");
}

std::string nrrd(const VoxelGrid& lps, const std::string& space, const Vector3& signs,
                 const std::string& encoding, const std::string& extra = "") {
  std::string h = "NRRD0004\n# made by a test\ntype: short\ndimension: 3\nspace: " + space +
                  "\nsizes: 14 11 9\nspace directions:";
  for (int a = 0; a < 3; ++a) {
    const Vector3 d = signs.cwiseProduct(lps.step_mm.col(a));
    h += fmt::format(" ({:.15g},{:.15g},{:.15g})", d.x(), d.y(), d.z());
  }
  const Vector3 o = signs.cwiseProduct(lps.origin_mm);
  h += fmt::format("\nendian: little\nencoding: {}\nspace origin: ({:.15g},{:.15g},{:.15g})\n{}\n", encoding,
                   o.x(), o.y(), o.z(), extra);
  const std::string voxels = voxels_of<std::int16_t>(lps, false, 1.0);
  return h + (encoding == "raw" ? voxels : gzipped(voxels));
}

TEST(Nrrd, SpacesDirectionsAndEncodings) {
  const VoxelGrid g = skew_grid();
  for (const char* encoding : {"raw", "gzip"})
    for (const auto& [space, signs] : std::map<std::string, Vector3>{{"left-posterior-superior", {1, 1, 1}},
                                                                     {"right-anterior-superior", {-1, -1, 1}},
                                                                     {"LAS", {1, -1, 1}}}) {
      const auto v = parse_nrrd(nrrd(g, space, signs, encoding), "a.nrrd");
      ASSERT_TRUE(v.has_value()) << v.error().line();
      expect_linear(v->volume, 0.51);  // whole numbers are stored
      EXPECT_TRUE(v->volume.grid.step_mm.isApprox(g.step_mm, 1e-12));
    }
  const std::string good = nrrd(g, "LPS", {1, 1, 1}, "raw");
  expect_refused(parse_nrrd(good.substr(0, good.size() - 1), "a.nrrd"), "truncated");
  expect_refused(parse_nrrd(nrrd(g, "scanner-xyz", {1, 1, 1}, "raw"), "a.nrrd"), "no patient's");
  expect_refused(parse_nrrd(nrrd(g, "LPS", {1, 1, 1}, "raw", "data file: a.raw\n"), "a.nrrd"),
                 "in another file");
  expect_refused(parse_nrrd(nrrd(g, "LPS", {1, 1, 1}, "raw", "space units: \"m\" \"m\" \"m\"\n"), "a.nrrd"),
                 "micrometres?");
  VoxelGrid small = g;
  small.step_mm *= 0.001;
  expect_refused(parse_nrrd(nrrd(small, "LPS", {1, 1, 1}, "raw"), "a.nrrd"), "metres?");
  Folder folder;
  folder.put("one.nrrd", good);
  EXPECT_TRUE(read(folder.path()).has_value());  // a folder with one volume means that volume
  folder.put("two.nrrd", good);
  expect_refused(read(folder.path()), "several volumes, name one: one.nrrd, two.nrrd");
}

}  // namespace
}  // namespace gnathion
