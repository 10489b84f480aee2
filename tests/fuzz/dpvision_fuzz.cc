// The readers of dpVision's workspaces against arbitrary bytes: any answer but a crash, a hang or a lie.
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>

#include "pipeline/dpvision_workspace.h"

namespace {

using namespace gnathion;

void require(bool condition, const char* promise) {
  if (condition) return;
  std::fprintf(stderr, "broken promise: %s\n", promise);
  std::abort();
}

void check(const DpNode& node, int depth) {
  require(depth <= 70, "nesting is bounded");
  require(node.matrix.allFinite(), "matrices are finite");
  for (const DpFrame& f : node.frames)
    require(f.matrix.allFinite() && f.duration_s >= 0, "frames are finite");
  for (const DpNode& child : node.children) check(child, depth + 1);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string bytes(reinterpret_cast<const char*>(data), size);
  if (const auto w = parse_dpw(bytes, "fuzz")) {
    for (const DpNode& node : w->nodes) check(node, 0);
    require(parse_dpw(format_dpw(*w), "again").has_value(), "what is written is read");
  }
  if (const auto w = parse_dpvision_structure(bytes, "fuzz"))
    for (const DpNode& node : w->nodes) check(node, 0);
  if (const auto a = parse_dpvision(bytes, "fuzz"))
    for (const DpNode& node : a->workspace.nodes) check(node, 0);
  return 0;
}
