// A workspace as dpVision's text.
#include <fmt/format.h>

#include "pipeline/dpvision_workspace.h"

namespace gnathion {
namespace {

/// Their texts have no escapes: a quote becomes an apostrophe.
std::string dp_quoted(const std::string& text) {
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? '\'' : static_cast<unsigned char>(c) < ' ' ? ' ' : c;
  return out + "\"";
}

std::string three(const std::array<double, 3>& v) {
  return fmt::format("[{} {} {}]", v[0], v[1], v[2]);
}

std::string matrix(const Matrix4& m) {
  std::string text = "[";
  for (int r = 0; r < 4; ++r)
    for (int c = 0; c < 4; ++c) text += fmt::format("{}{}", r + c == 0 ? "" : c == 0 ? "  " : " ", m(r, c));
  return text + "]";
}

const char* word_of(DpNode::Kind kind) {
  using Kind = DpNode::Kind;
  switch (kind) {
    case Kind::kShell:
      return "shell";
    case Kind::kPlane:
      return "plane";
    case Kind::kPoint:
      return "point";
    case Kind::kSphere:
      return "sphere";
    case Kind::kTriangle:
      return "triangle";
    case Kind::kAnimation:
      return "animation";
    default:
      return "transformation";
  }
}

void write(const DpNode& n, const std::string& indent, std::string& out) {
  using Kind = DpNode::Kind;
  const std::string in = indent + "  ";
  out += indent + word_of(n.kind) + " {\n";
  if (!n.label.empty()) out += in + "label " + dp_quoted(n.label) + "\n";
  std::string words;
  for (const std::string& k : n.keywords) words += (words.empty() ? "" : ";") + k;
  if (!words.empty()) out += in + "keywords " + dp_quoted(words) + "\n";
  if (!n.description.empty()) out += in + "descr " + dp_quoted(n.description) + "\n";
  switch (n.kind) {
    case Kind::kTransformation:
      out += in + "matrix " + matrix(n.matrix) + "\n";
      break;
    case Kind::kShell:
      out += in + "file " + dp_quoted(n.file) + "\n";
      break;
    case Kind::kPlane:
      out += fmt::format("{0}center {1}\n{0}normal {2}\n{0}size {3}\n", in, three(n.centre_mm),
                         three(n.normal), n.size_mm);
      break;
    case Kind::kPoint:
      out += fmt::format("{0}coords {1}\n{0}normal {2}\n", in, three(n.centre_mm), three(n.normal));
      break;
    case Kind::kSphere:
      out += fmt::format("{0}coords {1}\n{0}radius {2}\n", in, three(n.centre_mm), n.size_mm);
      break;
    case Kind::kTriangle:
      out += fmt::format("{0}coordsA {1}\n{0}coordsB {2}\n{0}coordsC {3}\n", in, three(n.centre_mm),
                         three(n.normal), three(n.third_mm));
      break;
    default:
      break;
  }
  if (n.kind == Kind::kAnimation) {
    out += in + "sequence {\n";
    for (const DpFrame& f : n.frames) {
      out += in + "  frame { ";
      if (!f.label.empty()) out += "label " + dp_quoted(f.label) + " ";
      out += fmt::format("delay {} matrix {} }}\n", f.duration_s, matrix(f.matrix));
    }
    out += in + "}\n";
  }
  if (n.kind == Kind::kAnimation && !n.children.empty()) out += in + "children {\n";
  for (const DpNode& c : n.children) write(c, n.kind == Kind::kAnimation ? in + "  " : in, out);
  if (n.kind == Kind::kAnimation && !n.children.empty()) out += in + "}\n";
  out += indent + "}\n";
}

}  // namespace

std::string format_dpw(const DpWorkspace& workspace) {
  std::string out = "# workspace of dpVision, written by gnathion; lengths in mm\n";
  for (const DpNode& n : workspace.nodes) write(n, "", out);
  return out;
}

}  // namespace gnathion
