#include "design/write_3mf.h"

#include <gtest/gtest.h>

#include <array>

#include "core/file.h"

// lib3mf 1.8's C interface, as far as the test reads with it (its headers need their own include path).
extern "C" {
int lib3mf_createmodel(void** model);
int lib3mf_release(void* instance);
int lib3mf_model_queryreader(void* model, const char* reader_class, void** reader);
int lib3mf_reader_readfromfileutf8(void* reader, const char* file);
int lib3mf_reader_getwarningcount(void* reader, unsigned* count);
int lib3mf_model_getmeshobjects(void* model, void** iterator);
int lib3mf_resourceiterator_movenext(void* iterator, int* has_next);
int lib3mf_resourceiterator_getcurrent(void* iterator, void** resource);
int lib3mf_meshobject_getvertexcount(void* mesh, unsigned* count);
int lib3mf_meshobject_gettrianglecount(void* mesh, unsigned* count);
int lib3mf_meshobject_ismanifoldandoriented(void* mesh, int* result);
int lib3mf_model_getunit(void* model, unsigned* unit);
int lib3mf_model_getmetadatacount(void* model, unsigned* count);
}

namespace gnathion {
namespace {

TriangleMesh tetrahedron() {
  TriangleMesh mesh;
  mesh.vertices_mm = {{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}};
  mesh.triangles = {{0, 2, 1}, {0, 1, 3}, {1, 2, 3}, {0, 3, 2}};
  return mesh;
}

const std::vector<std::pair<std::string, std::string>> kMetadata = {{"T_th", "[[1,0,0,0]]"},
                                                                    {"note", "a<b & \"c\""}};

std::filesystem::path temporary(const std::string& name) {
  return std::filesystem::path(testing::TempDir()) / name;
}

TEST(Write3mf, Lib3mfReadsTheSameSolidBack) {
  const auto path = temporary("gnathion_write_3mf_test.3mf");
  const Status status = write_3mf(path, tetrahedron(), kMetadata);
  ASSERT_TRUE(status.has_value()) << status.error().line();
  void *model = nullptr, *reader = nullptr, *iterator = nullptr, *mesh = nullptr;
  ASSERT_EQ(lib3mf_createmodel(&model), 0);
  ASSERT_EQ(lib3mf_model_queryreader(model, "3mf", &reader), 0);
  ASSERT_EQ(lib3mf_reader_readfromfileutf8(reader, path.c_str()), 0);
  unsigned warnings = 99, unit = 99, vertices = 0, triangles = 0;
  EXPECT_EQ(lib3mf_reader_getwarningcount(reader, &warnings), 0);
  EXPECT_EQ(warnings, 0u);
  EXPECT_EQ(lib3mf_model_getunit(model, &unit), 0);
  EXPECT_EQ(unit, 1u);  // MODELUNIT_MILLIMETER
  int more = 0, manifold = 0;
  ASSERT_EQ(lib3mf_model_getmeshobjects(model, &iterator), 0);
  ASSERT_EQ(lib3mf_resourceiterator_movenext(iterator, &more), 0);
  ASSERT_TRUE(more);
  ASSERT_EQ(lib3mf_resourceiterator_getcurrent(iterator, &mesh), 0);
  lib3mf_meshobject_getvertexcount(mesh, &vertices);
  lib3mf_meshobject_gettrianglecount(mesh, &triangles);
  lib3mf_meshobject_ismanifoldandoriented(mesh, &manifold);
  EXPECT_EQ(vertices, 4u);
  EXPECT_EQ(triangles, 4u);
  EXPECT_TRUE(manifold);
  for (void* instance : {mesh, iterator, reader, model}) lib3mf_release(instance);
  std::filesystem::remove(path);
}

TEST(Write3mf, SameInputGivesTheSameBytes) {
  const auto a = temporary("gnathion_a.3mf"), b = temporary("gnathion_b.3mf");
  ASSERT_TRUE(write_3mf(a, tetrahedron(), kMetadata).has_value());
  ASSERT_TRUE(write_3mf(b, tetrahedron(), kMetadata).has_value());
  EXPECT_EQ(read_file(a).value(), read_file(b).value());
  std::filesystem::remove(a);
  std::filesystem::remove(b);
}

}  // namespace
}  // namespace gnathion
