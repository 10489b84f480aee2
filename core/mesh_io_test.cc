#include "core/mesh_io.h"

#include <gtest/gtest.h>

#include <unistd.h>

#include <algorithm>
#include <clocale>
#include <cstring>
#include <fstream>
#include <limits>
#include <locale>

#include "core/mesh_test_shapes.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

constexpr MeshFormat kAllFormats[] = {MeshFormat::kStlBinary, MeshFormat::kStlAscii,
                                      MeshFormat::kPlyBinary, MeshFormat::kPlyBinaryBigEndian,
                                      MeshFormat::kPlyAscii,  MeshFormat::kObj};
constexpr MeshFormat kStlFormats[] = {MeshFormat::kStlBinary, MeshFormat::kStlAscii};

const char* extension_of(MeshFormat format) {
  if (format == MeshFormat::kObj) return "mesh.obj";
  return format == MeshFormat::kStlBinary || format == MeshFormat::kStlAscii ? "mesh.stl" : "mesh.ply";
}

/// Coordinates as they come: many digits, in single precision (as STL holds them) or double.
TriangleMesh awkward_mesh(bool single_precision) {
  TriangleMesh mesh = test::spiky(3, 77);
  for (Vector3& v : mesh.vertices_mm) {
    v = v * 0.123456789 + Vector3(1e-7, 31.4159, -1e3);
    // Through memory: g++ 12.2 at -O2 drops the pair of conversions in (double)(float)x of neighbours.
    if (!single_precision) continue;
    for (int k = 0; k < 3; ++k) {
      volatile float rounded = static_cast<float>(v[k]);
      v[k] = static_cast<double>(rounded);
    }
  }
  return mesh;
}

/// Folder that goes away with the test.
struct Scratch {
  Scratch() : path(fs::path(testing::TempDir()) / ("gnathion_mesh_io_" + std::to_string(::getpid()))) {
    fs::remove_all(path);
    fs::create_directories(path);
  }
  ~Scratch() { fs::remove_all(path); }
  fs::path file(const std::string& name, const std::string& bytes) const {
    fs::create_directories((path / name).parent_path());
    std::ofstream(path / name, std::ios::binary) << bytes;
    return path / name;
  }
  fs::path path;
};

void expect_same_corners(const TriangleMesh& a, const TriangleMesh& b) {
  ASSERT_EQ(a.triangles.size(), b.triangles.size());
  for (std::size_t i = 0; i < a.triangles.size(); ++i)
    for (int k = 0; k < 3; ++k) ASSERT_EQ(a.corner(i, k), b.corner(i, k)) << i;
}

/// The reason of a refusal; the code must be that of bad input, the name must be in it.
std::string refusal(const std::string& bytes, const std::string& name) {
  const auto mesh = parse_mesh(bytes, name);
  if (mesh) return "accepted";
  EXPECT_EQ(mesh.error().code, ErrorCode::kInput);
  EXPECT_EQ(mesh.error().what, "cannot read mesh");
  EXPECT_EQ(mesh.error().where, name);
  EXPECT_EQ(mesh.error().line().find('\n'), std::string::npos);
  return mesh.error().why;
}

#define EXPECT_REFUSED(bytes, name, reason) \
  EXPECT_PRED_FORMAT2(testing::IsSubstring, reason, refusal(bytes, name))

TEST(MeshIo, RoundTripsAreExact) {
  for (const MeshFormat format : kAllFormats) {
    const TriangleMesh mesh = awkward_mesh(format == MeshFormat::kStlBinary);
    const auto again = parse_mesh(format_mesh(mesh, format), extension_of(format));
    ASSERT_TRUE(again) << again.error().line();
    expect_same_corners(*again, mesh);
    EXPECT_EQ(again->vertices_mm.size(), mesh.vertices_mm.size());  // STL: welded again
    if (format != MeshFormat::kStlBinary && format != MeshFormat::kStlAscii) {
      EXPECT_EQ(again->triangles, mesh.triangles);
    }
  }
}

TEST(MeshIo, KindIsToldByContentWhateverTheName) {
  const TriangleMesh mesh = test::tetrahedron();
  for (const MeshFormat format : kAllFormats)
    for (const char* name : {"a.stl", "a.ply", "a", "a.dat"}) {
      if (format == MeshFormat::kObj && std::string(name).size() > 5) continue;
      const std::string bytes = format_mesh(mesh, format);
      if (format == MeshFormat::kObj && (std::string(name) == "a.stl" || std::string(name) == "a.ply"))
        continue;
      const auto again = parse_mesh(bytes, name);
      ASSERT_TRUE(again) << name << ' ' << again.error().line();
      expect_same_corners(*again, mesh);
    }
}

TEST(MeshIo, ColoursSurviveEveryFormatThatHoldsThem) {
  TriangleMesh mesh = test::sphere(3, 5.0);
  Random random(5);
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i)
    mesh.colors_rgb.push_back(
        {std::uint8_t(i), std::uint8_t(random.below(256)), std::uint8_t(255 - i % 256)});
  for (const MeshFormat format : kAllFormats) {
    const auto again = parse_mesh(format_mesh(mesh, format), extension_of(format));
    ASSERT_TRUE(again) << again.error().line();
    if (format == MeshFormat::kStlBinary || format == MeshFormat::kStlAscii)
      EXPECT_TRUE(again->colors_rgb.empty());
    else
      EXPECT_EQ(again->colors_rgb, mesh.colors_rgb);
  }
}

/// A locale with decimal comma and grouped digits that is there on every machine.
struct CommaNumbers : std::numpunct<char> {
  char do_decimal_point() const override { return ','; }
  char do_thousands_sep() const override { return '.'; }
  std::string do_grouping() const override { return "\3"; }
};

TEST(MeshIo, NumbersDoNotDependOnTheLocale) {
  const std::string c_before = std::setlocale(LC_ALL, nullptr);
  const std::locale before = std::locale::global(std::locale(std::locale::classic(), new CommaNumbers));
  for (const char* name : {"de_DE.UTF-8", "pl_PL.UTF-8", "fr_FR.UTF-8"})  // where installed
    if (std::setlocale(LC_ALL, name) != nullptr) break;
  const TriangleMesh mesh = awkward_mesh(false);
  std::vector<Result<TriangleMesh>> again;
  for (const MeshFormat format : {MeshFormat::kStlAscii, MeshFormat::kPlyAscii, MeshFormat::kObj})
    again.push_back(parse_mesh(format_mesh(mesh, format), extension_of(format)));
  std::locale::global(before);
  std::setlocale(LC_ALL, c_before.c_str());
  for (const auto& m : again) {
    ASSERT_TRUE(m) << m.error().line();
    expect_same_corners(*m, mesh);
  }
}

TEST(MeshIo, BinaryStlMayBeginWithSolid) {
  std::string bytes = format_mesh(awkward_mesh(true), MeshFormat::kStlBinary);
  const std::string title = "solid exported by a scanner facet normal";
  std::copy(title.begin(), title.end(), bytes.begin());
  const auto mesh = parse_mesh(bytes, "a.stl");
  ASSERT_TRUE(mesh) << mesh.error().line();
  expect_same_corners(*mesh, awkward_mesh(true));
  // Cut, it is still a binary one.
  EXPECT_REFUSED(bytes.substr(0, bytes.size() - 60), "a.stl",
                 "truncated: 512 triangles announced, 510 present");
}

TEST(MeshIo, AsciiStlOfManySortsIsRead) {
  const std::string text =
      "  SOLID a name with spaces\r\n"
      "\tFacet Normal nan nan nan\r\n outer loop\r\n vertex +0 0. 0\r\n vertex 1E+0 0 0\r\n vertex 0 1.0e0 "
      "-0\r\n"
      " endloop\r\n endfacet\r\nendsolid a name with spaces\r\n"
      "solid\nfacet normal 0 0 1 outer loop vertex 1 0 0 vertex 1 1 0 vertex 0 1 0 endloop "
      "endfacet\nendsolid";
  const auto mesh = parse_mesh(text, "a.stl");
  ASSERT_TRUE(mesh) << mesh.error().line();
  EXPECT_EQ(mesh->triangles.size(), 2u);
  EXPECT_EQ(mesh->vertices_mm.size(), 4u);
}

TEST(MeshIo, AsciiStlRefusals) {
  const std::string good = format_mesh(test::tetrahedron(), MeshFormat::kStlAscii);
  EXPECT_REFUSED(good.substr(0, good.find("endsolid")), "a.stl",
                 "truncated: ends in line 30 after 4 whole triangles");
  EXPECT_REFUSED(good.substr(0, good.size() / 2), "a.stl", "truncated");
  std::string bad = good;
  bad.replace(bad.find("vertex"), 6, "vertix");
  EXPECT_REFUSED(bad, "a.stl", "line 4: \"vertex\" expected, \"vertix\" found");
  bad = good;
  bad.replace(bad.find("vertex") + 7, 1, "x");
  EXPECT_REFUSED(bad, "a.stl", "line 4: \"number\" expected, \"x\" found");
  EXPECT_REFUSED("solid a\nendsolid a\n", "a.stl", "no triangles");
}

TEST(MeshIo, BinaryStlRefusals) {
  const std::string good = format_mesh(test::sphere(2, 5), MeshFormat::kStlBinary);
  EXPECT_REFUSED(good.substr(0, 50), "a.stl", "truncated: 50 bytes");
  EXPECT_REFUSED(good.substr(0, good.size() - 1), "a.stl", "truncated: 128 triangles announced, 127 present");
  EXPECT_REFUSED(good + good, "a.stl", "128 triangles announced, but there are bytes for 257");
  std::string lie = good;
  lie[80] = lie[81] = lie[82] = lie[83] = '\xff';
  EXPECT_REFUSED(lie, "a.stl", "truncated: 4294967295 triangles announced, 128 present");
  EXPECT_REFUSED(std::string(84, '\0'), "a.stl", "no triangles");
  EXPECT_REFUSED(std::string(), "a.stl", "the file is empty");
}

TEST(MeshIo, NoNumberThatIsNone) {
  for (const double value : {std::nan(""), std::numeric_limits<double>::infinity(), -HUGE_VAL, 1e30}) {
    for (const MeshFormat format : kAllFormats) {
      TriangleMesh mesh = test::sphere(2, 5);
      mesh.vertices_mm[mesh.triangles[20][1]].y() = value;
      const std::string why = refusal(format_mesh(mesh, format), extension_of(format));
      EXPECT_NE(why.find(value == 1e30 ? "beyond all measure" : "NaN or infinite"), std::string::npos) << why;
      EXPECT_TRUE(why.find("triangle") == 0 || why.find("vertex") == 0) << why;
    }
  }
  EXPECT_REFUSED("v 0 0 1e999\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a.obj", "vertex 1 has a NaN or infinite");
  EXPECT_REFUSED("v 0 0 0\nv 1 0 0\nv 0 1 nan\nf 1 2 3\n", "a.obj", "vertex 3 has a NaN or infinite");
  EXPECT_TRUE(parse_mesh("v 0 0 1e-999\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "a.obj"));
}

TEST(MeshIo, OnlyDegenerateTrianglesAreNoMesh) {
  TriangleMesh line;
  line.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {2, 0, 0}};
  line.triangles = {{0, 1, 2}, {0, 0, 1}};
  for (const MeshFormat format : kAllFormats)
    EXPECT_REFUSED(format_mesh(line, format), extension_of(format), "only degenerate triangles");
  // One good triangle among them is enough; collapsed ones and unused vertices are left behind.
  line.vertices_mm.emplace_back(0, 1, 0);
  line.vertices_mm.emplace_back(500, 500, 500);
  line.triangles.push_back({0, 1, 3});
  for (const MeshFormat format : kAllFormats) {
    const auto mesh = parse_mesh(format_mesh(line, format), extension_of(format));
    ASSERT_TRUE(mesh);
    EXPECT_EQ(mesh->triangles.size(), 2u);
    EXPECT_EQ(bounding_box(*mesh).max_mm, Vector3(2, 1, 0));
  }
}

/// Every cut of a small file is refused or harmless, and nothing crashes.
TEST(MeshIo, EveryCutOfEveryFormat) {
  TriangleMesh mesh = test::sphere(1, 5);
  mesh.colors_rgb.assign(mesh.vertices_mm.size(), {1, 2, 3});
  for (const MeshFormat format : kAllFormats) {
    const std::string whole = format_mesh(mesh, format);
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const auto part = parse_mesh(whole.substr(0, size), extension_of(format));
      if (!part || format == MeshFormat::kObj) continue;  // OBJ does not say how long it is
      // At most blanks at the end, the digits of the last index, or the name after "endsolid" are missing.
      const bool text = format == MeshFormat::kStlAscii || format == MeshFormat::kPlyAscii;
      ASSERT_TRUE(text && whole.size() - size <= 10) << size << " of " << whole.size();
    }
  }
}

/// Random damage: any answer but a crash, and an accepted mesh keeps its promises.
TEST(MeshIo, RandomDamage) {
  Random random(99);
  TriangleMesh mesh = test::sphere(1, 5);
  mesh.colors_rgb.assign(mesh.vertices_mm.size(), {1, 2, 3});
  for (const MeshFormat format : kAllFormats) {
    const std::string whole = format_mesh(mesh, format);
    for (int i = 0; i < 3000; ++i) {
      std::string bytes = whole;
      for (std::uint32_t n = random.below(4) + 1; n > 0; --n)
        bytes[random.below(std::uint32_t(bytes.size()))] = char(random.below(256));
      const auto damaged = parse_mesh(bytes, extension_of(format));
      if (!damaged) continue;
      ASSERT_FALSE(damaged->empty());
      for (const Vector3& v : damaged->vertices_mm) ASSERT_TRUE(v.allFinite());
      for (const Triangle& t : damaged->triangles)
        for (const std::uint32_t v : t) ASSERT_LT(v, damaged->vertices_mm.size());
    }
  }
}

const char kPlyWithExtras[] =
    "ply\r\nformat ascii 1.0\r\ncomment TextureFile skin of face.png\r\nobj_info whatever 3\r\n"
    "element camera 1\r\nproperty float fov\r\nproperty list uchar int extra\r\n"
    "element vertex 5\r\nproperty float nx\r\nproperty double x\r\nproperty float y\r\nproperty int16 z\r\n"
    "property list uint8 float weights\r\nproperty float red\r\nproperty float green\r\nproperty float "
    "blue\r\n"
    "property uchar alpha\r\n"
    "element face 2\r\nproperty uchar flags\r\nproperty list uchar uint vertex_index\r\n"
    "property list uchar float texcoord\r\n"
    "element edge 1\r\nproperty int vertex1\r\nproperty int vertex2\r\nend_header\r\n"
    "45.5 3 1 2 3\r\n"
    "0 0 0 0 0 1 0 0.5 255\r\n0 1 0 0 2 .5 .5 0 1 0 255\r\n0 1 1 0 0 0 0 1 255\r\n0 0 1 0 0 1 1 1 255\r\n"
    "0 0.5 0.5 2 0 0 0 0 255\r\n"
    "7 4 0 1 2 3 8 0 0 1 0 1 1 0 1\r\n7 3 0 1 4 0\r\n"
    "0 1\r\n";

TEST(MeshIo, PlyWithEverythingThatMayOccur) {
  const auto mesh = parse_mesh(kPlyWithExtras, "face.ply");
  ASSERT_TRUE(mesh) << mesh.error().line();
  EXPECT_EQ(mesh->texture_file, "skin of face.png");
  ASSERT_EQ(mesh->vertices_mm.size(), 5u);
  EXPECT_EQ(mesh->vertices_mm[4], Vector3(0.5, 0.5, 2));
  EXPECT_EQ(mesh->triangles, (std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}, {0, 1, 4}}));
  ASSERT_EQ(mesh->colors_rgb.size(), 5u);
  EXPECT_EQ(mesh->colors_rgb[0], (std::array<std::uint8_t, 3>{255, 0, 128}));
  EXPECT_EQ(mesh->colors_rgb[3], (std::array<std::uint8_t, 3>{255, 255, 255}));
}

template <class T>
void put(std::string& out, T value, bool big) {
  char bytes[sizeof value];
  std::memcpy(bytes, &value, sizeof value);
  if (big) std::reverse(bytes, bytes + sizeof value);
  out.append(bytes, sizeof value);
}

TEST(MeshIo, BinaryPlyWithExtrasInBothEndians) {
  for (const bool big : {false, true}) {
    std::string ply =
        std::string("ply\nformat ") + (big ? "binary_big_endian" : "binary_little_endian") +
        " 1.0\nelement material 3\nproperty short a\nproperty double b\n"
        "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty list uchar short "
        "l\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        "element face 1\nproperty list ushort ushort vertex_indices\nproperty float quality\nend_header\n";
    for (int i = 0; i < 3; ++i) {
      put(ply, std::int16_t(i), big);
      put(ply, 3.5, big);
    }
    for (int i = 0; i < 4; ++i) {
      put(ply, float(i == 1 || i == 2), big);
      put(ply, float(i >= 2), big);
      put(ply, 0.25f, big);
      ply += char(i);
      for (int j = 0; j < i; ++j) put(ply, std::int16_t(-j), big);
      ply += "\x10\x20\xff";
    }
    put(ply, std::uint16_t(4), big);
    for (std::uint16_t v = 0; v < 4; ++v) put(ply, v, big);
    put(ply, 0.5f, big);
    const auto mesh = parse_mesh(ply, "a.ply");
    ASSERT_TRUE(mesh) << mesh.error().line();
    EXPECT_EQ(mesh->triangles.size(), 2u);
    EXPECT_EQ(mesh->vertices_mm[2], Vector3(1, 1, 0.25));
    EXPECT_EQ(mesh->colors_rgb[3], (std::array<std::uint8_t, 3>{16, 32, 255}));
    EXPECT_DOUBLE_EQ(surface_area_mm2(*mesh), 1.0);
  }
}

std::string ply_with(const std::string& header, const std::string& body, const char* format = "ascii") {
  return std::string("ply\nformat ") + format + " 1.0\n" + header + "end_header\n" + body;
}

TEST(MeshIo, PlyRefusals) {
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  const std::string faces = "property list uchar int vertex_indices\n";
  const std::string head = "element vertex 3\n" + xyz + "element face 1\n" + faces;
  const std::string points = "0 0 0\n1 0 0\n0 1 0\n";
  EXPECT_TRUE(parse_mesh(ply_with(head, points + "3 0 1 2"), "a.ply"));
  EXPECT_REFUSED(ply_with(head, points + "3 0 1 3"), "a.ply", "index out of range");
  EXPECT_REFUSED(ply_with(head, points + "3 0 1 -1"), "a.ply", "face 1 names vertex -1: index out of range");
  EXPECT_REFUSED(ply_with(head, points + "3 0 1"), "a.ply",
                 "truncated: 1 rows of element face announced, 0 present");
  EXPECT_REFUSED(ply_with(head, points + "-3 0 1 2"), "a.ply", "a list of -3 entries");
  EXPECT_REFUSED(ply_with(head, "0 0 0\n1 0 zero\n"), "a.ply", "row 2 of element vertex has \"zero\"");
  EXPECT_REFUSED(ply_with("element vertex 3\n" + xyz, points), "a.ply", "a point cloud?");
  EXPECT_REFUSED(ply_with("element face 1\n" + faces, "3 0 1 2"), "a.ply", "no vertices");
  EXPECT_REFUSED(ply_with("element vertex -3\n", ""), "a.ply", "impossible number of rows \"-3\"");
  EXPECT_REFUSED(ply_with("element vertex 99999999999999999999\n", ""), "a.ply", "impossible number of rows");
  EXPECT_REFUSED(ply_with("property float x\n", ""), "a.ply", "a property before any element");
  EXPECT_REFUSED(ply_with("element vertex 3\nproperty quad x\n", ""), "a.ply", "unknown type \"quad\"");
  EXPECT_REFUSED(ply_with("element vertex 3\nproperty list float int x\n", ""), "a.ply",
                 "line 4 of the header has");
  EXPECT_REFUSED(ply_with(head, points + "3 0 1 2", "binary_middle_endian"), "a.ply", "unknown format");
  EXPECT_REFUSED("ply\nelement vertex 3\n" + xyz + "end_header\n", "a.ply", "does not say its format");
  EXPECT_REFUSED("ply\nformat ascii 1.0\n" + head, "a.ply", "truncated: ends inside the header");
  EXPECT_REFUSED("polygon\n", "a.ply", "not a PLY file");
}

TEST(MeshIo, LyingHeadersTakeNoMemory) {
  // Each would take hundreds of gigabytes if it were believed.
  const std::string xyz = "property float x\nproperty float y\nproperty float z\n";
  const std::string faces = "property list uint int vertex_indices\n";
  for (const char* format : {"ascii", "binary_little_endian", "binary_big_endian"}) {
    const std::string body(200, '1');
    EXPECT_REFUSED(ply_with("element vertex 100000000000\n" + xyz + "element face 1\n" + faces, body, format),
                   "a.ply", "truncated: 100000000000 rows of element vertex announced");
    EXPECT_REFUSED(ply_with("element vertex 1\n" + xyz + "element face 9000000000000000000\n" + faces,
                            "1 1 1 " + body, format),
                   "a.ply", "");
    EXPECT_REFUSED(ply_with("element other 9000000000000000000\nproperty double a\nelement vertex 1\n" + xyz +
                                "element face 1\n" + faces,
                            body, format),
                   "a.ply", "rows of element other announced");
    // Rows without properties: nothing to read, nothing to wait for.
    EXPECT_REFUSED(
        ply_with("element nothing 9000000000000000000\nelement vertex 3\n" + xyz + "element face 1\n" + faces,
                 "", format),
        "a.ply", "truncated");
  }
}

TEST(MeshIo, ObjOfEveryIndexForm) {
  const std::string text =
      "# a comment\r\nmtllib none.mtl\r\no thing\r\n"
      "v 0 0 0\r\nv 1 0 0 1.0\r\nv 1 1 0\r\nv 0 1 0\r\nvt 0 0\r\nvn 0 0 1\r\n"
      "usemtl skin\r\ns off\r\n"
      "f 1/1/1 2/1/1 3/1/1 4/1/1\r\n"
      "v 0.5 0.5 3\r\n"
      "f -1//1 1//1 2//1\r\n"
      "f 2/1 3/1 \\\r\n 5/1\r\n"
      "f 3 4 -1\r\nl 1 2\r\ng last\r\nf 5 4 1";
  const auto mesh = parse_mesh(text, "a.obj");
  ASSERT_TRUE(mesh) << mesh.error().line();
  EXPECT_EQ(mesh->triangles,
            (std::vector<Triangle>{{0, 1, 2}, {0, 2, 3}, {4, 0, 1}, {1, 2, 4}, {2, 3, 4}, {4, 3, 0}}));
  EXPECT_TRUE(mesh->colors_rgb.empty());  // the fourth number is a weight
  EXPECT_TRUE(mesh->texture_file.empty());
}

/// A comb: concave whichever corner one begins at; its area is known.
std::vector<Vector3> comb(const Matrix3& rotation, std::size_t first_corner) {
  std::vector<Vector3> corners;
  for (int tooth = 0; tooth < 5; ++tooth) {  // teeth 1 wide and 10 high, 1 apart, on a bar 1 high
    corners.emplace_back(2 * tooth, 1, 0);
    corners.emplace_back(2 * tooth, 11, 0);
    corners.emplace_back(2 * tooth + 1, 11, 0);
    corners.emplace_back(2 * tooth + 1, 1, 0);
  }
  corners.emplace_back(9, 0, 0);
  corners.emplace_back(0, 0, 0);
  std::reverse(corners.begin(), corners.end());  // counter-clockwise
  std::rotate(corners.begin(), corners.begin() + std::ptrdiff_t(first_corner), corners.end());
  for (Vector3& c : corners) c = rotation * c;
  return corners;
}

TEST(MeshIo, ConcavePolygonsAreCutInsideThemselves) {
  Random random(8);
  for (std::size_t first = 0; first < 22; ++first) {
    const Matrix3 rotation = random.rotation();
    const std::vector<Vector3> corners = comb(rotation, first);
    std::string obj, faces = "f";
    for (std::size_t i = 0; i < corners.size(); ++i) {
      for (int k = 0; k < 3; ++k) obj += (k ? " " : "v ") + std::to_string(corners[i][k]);
      obj += "\n";
      faces += " " + std::to_string(i + 1);
    }
    const auto mesh = parse_mesh(obj + faces + "\n", "comb.obj");
    ASSERT_TRUE(mesh) << mesh.error().line();
    EXPECT_EQ(mesh->triangles.size(), 20u);
    // Overlapping or outlying triangles would make the surface larger than the polygon.
    EXPECT_NEAR(surface_area_mm2(*mesh), 5 * 10.0 + 9.0, 1e-4);
    for (std::size_t i = 0; i < mesh->triangles.size(); ++i) {
      const Vector3 n = face_normal_scaled(*mesh, i);
      if (n.norm() > 1e-3) {  // the feet of the teeth are in one line: slivers of six digits' rounding
        EXPECT_GT(n.normalized().dot(rotation.col(2)), 0.999);
      }
    }
    EXPECT_EQ(mesh_topology(*mesh).boundary_edges, 22u);
  }
}

TEST(MeshIo, PolygonsThatCrossThemselvesDoNotHang) {
  std::string obj;
  Random random(9);
  for (int i = 0; i < 600; ++i)
    obj += "v " + std::to_string(random.normal()) + " " + std::to_string(random.normal()) + " 0\n";
  for (const int corners : {4, 5, 30, 500, 600}) {
    std::string face = "f";
    for (int i = 1; i <= corners; ++i) face += " " + std::to_string(i);
    const auto mesh = parse_mesh(obj + face + "\n", "knot.obj");
    ASSERT_TRUE(mesh);
    EXPECT_EQ(mesh->triangles.size(), std::size_t(corners - 2));
  }
}

TEST(MeshIo, ObjColoursBehindCoordinates) {
  const auto mesh = parse_mesh("v 0 0 0 1 0 0.5\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n", "a.obj");
  ASSERT_TRUE(mesh);
  ASSERT_EQ(mesh->colors_rgb.size(), 3u);
  EXPECT_EQ(mesh->colors_rgb[0], (std::array<std::uint8_t, 3>{255, 0, 128}));
  const auto partly = parse_mesh("v 0 0 0 1 0 0.5\nv 1 0 0\nv 0 1 0 0 0 1\nf 1 2 3\n", "a.obj");
  ASSERT_TRUE(partly);
  EXPECT_TRUE(partly->colors_rgb.empty());
}

TEST(MeshIo, ObjTextureOfTheMaterialWithMostFaces) {
  const Scratch scratch;
  scratch.file("maps/a.mtl",
               "newmtl hair\nKd 1 1 1\nmap_Kd hair.jpg\nnewmtl skin\nmap_Kd -s 1 1 1 skin.png\n");
  scratch.file("b two.mtl", "newmtl shirt\r\nmap_Kd shirt front.png\r\nnewmtl plain\r\nKd 1 0 0\r\n");
  const std::string vertices = "mtllib maps/a.mtl\nmtllib b two.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\n";
  const auto texture = [&](const std::string& faces) {
    const auto mesh = read_mesh(scratch.file("face.obj", vertices + faces));
    return mesh ? mesh->texture_file : mesh.error().line();
  };
  EXPECT_EQ(texture("usemtl hair\nf 1 2 3\nusemtl skin\nf 1 2 3\nf 2 3 4\n"), "maps/skin.png");
  EXPECT_EQ(texture("usemtl hair\nf 1 2 3\nf 2 3 4\nusemtl skin\nf 1 2 3\n"), "maps/hair.jpg");
  EXPECT_EQ(texture("usemtl shirt\nf 1 2 3\nusemtl plain\nf 1 2 3\nf 2 3 4\n"), "shirt front.png");
  EXPECT_EQ(texture("usemtl unknown\nf 1 2 3\n"), "");
  // Out of reach: no texture, and no refusal.
  const auto alone = parse_mesh(vertices + "usemtl hair\nf 1 2 3\n", (scratch.path / "face.obj").string());
  ASSERT_TRUE(alone);
  EXPECT_EQ(alone->texture_file, "");
}

TEST(MeshIo, ObjRefusals) {
  const std::string points = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  EXPECT_REFUSED(points + "f 1 2 4\n", "a.obj", "line 4: vertex index 4 out of range, there are 3 vertices");
  EXPECT_REFUSED(points + "f 0 1 2\n", "a.obj", "line 4: vertex index 0 out of range");
  EXPECT_REFUSED(points + "f -4 1 2\n", "a.obj", "line 4: vertex index -4 out of range");
  EXPECT_REFUSED(points + "f 1 2 99999999999999999999\n", "a.obj", "no vertex index");
  EXPECT_REFUSED(points + "f 1 2 9999999999\n", "a.obj", "out of range");
  EXPECT_REFUSED(points + "f 1 2\n", "a.obj", "line 4: a face with 2 corners");
  EXPECT_REFUSED(points + "f 1 b 3\n", "a.obj", "\"b\" is no vertex index");
  EXPECT_REFUSED("v 0 0\n" + points + "f 1 2 3\n", "a.obj", "line 1: a vertex with 2 coordinates");
  EXPECT_REFUSED("v 0 0,5 0\n" + points + "f 1 2 3\n", "a.obj", "line 1: \"0,5\" is no number");
  EXPECT_REFUSED(points, "a.obj", "no triangles");
  EXPECT_REFUSED("# Vertices: 3\n# Faces: 2\n" + points + "f 1 2 3\n", "a.obj",
                 "truncated: 3 vertices and 2 faces announced, 3 and 1 present");
  EXPECT_REFUSED("hello, world\n", "a.txt", "neither STL nor PLY nor OBJ");
  EXPECT_REFUSED(std::string("\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16), "a.obj", "neither STL nor PLY nor OBJ");
}

TEST(MeshIo, FilesAreWrittenWholeOrNotAtAll) {
  const Scratch scratch;
  const TriangleMesh mesh = awkward_mesh(true);
  for (const char* name : {"a.stl", "b.PLY", "c.obj"}) {
    ASSERT_TRUE(write_mesh(scratch.path / name, mesh));
    const auto again = read_mesh(scratch.path / name);
    ASSERT_TRUE(again) << again.error().line();
    expect_same_corners(*again, mesh);
  }
  const auto entries = [&] {
    return std::distance(fs::directory_iterator(scratch.path), fs::directory_iterator());
  };
  EXPECT_EQ(entries(), 3);
  EXPECT_EQ(fs::file_size(scratch.path / "a.stl"), 84 + 50 * mesh.triangles.size());
  // No such kind, no triangles, no number, no folder: an error and nothing new on disk.
  const auto unknown = write_mesh(scratch.path / "a.xyz", mesh);
  ASSERT_FALSE(unknown);
  EXPECT_EQ(unknown.error().code, ErrorCode::kUsage);
  EXPECT_FALSE(write_mesh(scratch.path / "d.stl", TriangleMesh()));
  TriangleMesh broken = mesh;
  broken.vertices_mm[3].z() = std::nan("");
  EXPECT_FALSE(write_mesh(scratch.path / "a.stl", broken));
  EXPECT_FALSE(write_mesh(scratch.path / "no/such/folder/a.stl", mesh));
  EXPECT_EQ(entries(), 3);
  EXPECT_TRUE(read_mesh(scratch.path / "a.stl"));
}

TEST(MeshIo, UnreadableFilesAreNamed) {
  const Scratch scratch;
  for (const fs::path& path : {scratch.path / "absent.stl", scratch.path}) {
    const auto mesh = read_mesh(path);
    ASSERT_FALSE(mesh);
    EXPECT_EQ(mesh.error().code, ErrorCode::kInput);
    EXPECT_EQ(mesh.error().where, path.string());
    EXPECT_FALSE(mesh.error().why.empty());
  }
  const auto empty = read_mesh(scratch.file("empty.stl", ""));
  ASSERT_FALSE(empty);
  EXPECT_EQ(empty.error().line(),
            "cannot read mesh: " + (scratch.path / "empty.stl").string() + ": the file is empty");
}

TEST(JawSize, NamesTheLikelyUnit) {
  const auto why = [](double extent) {
    const auto status = check_jaw_size(test::box({0, 0, 0}, {extent, extent * 0.8, extent * 0.3}), "jaw.stl");
    if (status) return std::string("accepted");
    EXPECT_EQ(status.error().code, ErrorCode::kInput);
    EXPECT_EQ(status.error().where, "jaw.stl");
    return status.error().why;
  };
  for (const double mm : {35.0, 60.0, 110.0}) EXPECT_EQ(why(mm), "accepted");
  const std::pair<double, const char*> units[] = {
      {0.06, "in metres"}, {0.04, "in metres"}, {60000, "in micrometres"}, {40000, "in micrometres"},
      {2.4, "in inches"},  {1.6, "in inches"},  {6.0, "in centimetres"},   {9.0, "in centimetres"}};
  for (const auto& [extent, unit] : units) EXPECT_PRED_FORMAT2(testing::IsSubstring, unit, why(extent));
  for (const double extent : {0.6, 20.0, 200.0, 1e6, 1e-5})
    EXPECT_PRED_FORMAT2(testing::IsSubstring, "not a jaw in millimetres", why(extent));
}

TEST(ReadJaw, AShellThatIsThereTwiceIsReadOnce) {
  const Scratch scratch;
  const TriangleMesh once = test::box({0, 0, 0}, {60, 48, 20});
  TriangleMesh turned = once;
  flip_orientation(turned);
  for (const TriangleMesh& second : {once, turned})
    for (const char* name : {"twice.stl", "twice.ply", "twice.obj"}) {
      ASSERT_TRUE(write_mesh(scratch.path / name, merged(once, second)));
      const auto jaw = read_jaw(scratch.path / name);
      ASSERT_TRUE(jaw) << jaw.error().line();
      EXPECT_EQ(jaw->triangles.size(), once.triangles.size()) << name;
      EXPECT_GT(signed_volume_mm3(*jaw), 0.0) << name;
    }
}

TEST(JawSize, RealJawsPassAndTheSameInMetresDoNot) {
  const auto data = test::shared_data();
  if (data.empty()) GTEST_SKIP() << "skipped: the shared data folder is not here";
  const Scratch scratch;
  for (const char* name :
       {"cast/maxilla.stl", "cast/mandible_mi.stl", "crowns/maxilla.stl", "crowns/mandible_mi.stl"}) {
    const auto jaw = read_jaw(data / "jaws" / name);
    ASSERT_TRUE(jaw) << jaw.error().line();
    TriangleMesh metres = *jaw;
    for (Vector3& v : metres.vertices_mm) v *= 0.001;
    ASSERT_TRUE(write_mesh(scratch.path / "metres.stl", metres));
    const auto refused = read_jaw(scratch.path / "metres.stl");
    ASSERT_FALSE(refused);
    EXPECT_PRED_FORMAT2(testing::IsSubstring, "metres", refused.error().why);
    // Through every format and back.
    for (const MeshFormat format : kAllFormats) {
      const auto again = parse_mesh(format_mesh(*jaw, format), extension_of(format));
      ASSERT_TRUE(again) << again.error().line();
      expect_same_corners(*again, *jaw);
    }
  }
  const auto skull = read_mesh(data / "skull/dry_skull/Skull.obj");
  ASSERT_TRUE(skull) << skull.error().line();
  EXPECT_EQ(skull->triangles.size(), 103514u);
  EXPECT_FALSE(check_jaw_size(*skull, "Skull.obj"));
  for (const MeshFormat format : kStlFormats)
    EXPECT_TRUE(parse_mesh(format_mesh(*skull, format), "skull.stl"));
}

}  // namespace
}  // namespace gnathion
