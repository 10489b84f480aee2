// The bodies of OpenIGTLink messages as poses, images, surfaces and states. Pure decoding.
#pragma once

#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "core/image.h"
#include "core/mesh.h"
#include "core/result.h"
#include "core/rigid.h"

namespace gnathion::igtl {

/// One instrument of a TRANSFORM (without a name of its own), TDATA or QTDATA message.
struct ToolPose {
  std::string name;
  Rigid3 reference_from_tool;  ///< mm; frame as the sender names it, no axis is flipped
  bool position_only = false;  ///< an instrument that has no orientation ("3D")
  std::string fault;           ///< why the numbers are no pose: not finite, not a rotation; empty: a pose
};
struct Poses {
  std::vector<ToolPose> tools;
};
struct Picture {
  Image8 image;      ///< one slice; colour becomes grey by ITU-R BT.601
  bool lps = false;  ///< the sender's axes: LPS, else RAS (of the orientation, which a frame does not keep)
};
struct State {
  std::uint16_t code = 0;  ///< 1: good; the others are in status_name()
  std::int64_t subcode = 0;
  std::string name, text;
  bool good() const { return code == 1; }
};

using Body = std::variant<Poses, Picture, TriangleMesh, State>;

/// TRANSFORM, TDATA, QTDATA, IMAGE, POLYDATA and STATUS.
bool is_read(std::string_view type);
/// `content` of a message of a type that is_read(). Every length inside is checked against what is there
/// before it is used. Refused by name: what the message says but a sample cannot hold (16-bit images,
/// volumes, parts of an image, surfaces without polygons).
struct DecodeOptions {
  bool normalise_quaternions = false;  ///< take quaternions of any length but about 0, as the library does
};
Result<Body> decode(const std::string& type, std::string_view content, const DecodeOptions& options = {});

/// "OK", "not ready", ...
std::string status_name(std::uint16_t code);

}  // namespace gnathion::igtl
