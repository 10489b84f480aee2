// The mesh readers against arbitrary bytes: any answer but a crash, a hang or a lie. What is accepted must
// keep the reader's promises, survive the facts that everything else asks of a mesh, and be written and read
// again as the same triangles.
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "core/mesh_io.h"

namespace {

void require(bool condition, const char* promise) {
  if (condition) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

void check_accepted(const gnathion::TriangleMesh& mesh) {
  using namespace gnathion;
  require(!mesh.triangles.empty(), "an accepted mesh has triangles");
  for (const Vector3& v : mesh.vertices_mm) require(v.allFinite(), "coordinates are finite");
  for (const Triangle& t : mesh.triangles)
    for (const std::uint32_t v : t) require(v < mesh.vertices_mm.size(), "indices are in range");
  require(mesh.colors_rgb.empty() || mesh.colors_rgb.size() == mesh.vertices_mm.size(),
          "a colour per vertex or none");
  const MeshTopology facts = mesh_topology(mesh);
  require(facts.degenerate_triangles < facts.triangles, "not all triangles are degenerate");
  require(boundary_loops(mesh).size() <= facts.boundary_edges, "a loop has edges");

  const auto again = parse_mesh(format_mesh(mesh, MeshFormat::kPlyBinary), "again.ply");
  require(again.has_value(), "what was read can be written and read again");
  require(again->triangles == mesh.triangles && again->vertices_mm == mesh.vertices_mm, "and is the same");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  for (const char* name : {"fuzz.stl", "fuzz.ply", "fuzz.obj", "fuzz"})
    if (const auto mesh = gnathion::parse_mesh(bytes, name)) check_accepted(*mesh);
  return 0;
}
