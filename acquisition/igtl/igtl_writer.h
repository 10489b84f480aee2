// Bodies of OpenIGTLink messages (version 1), the other way from igtl_messages.h. Pure.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "acquisition/igtl/igtl_messages.h"
#include "core/image.h"
#include "core/mesh.h"
#include "core/rigid.h"
#include "core/time.h"

namespace gnathion::igtl {

/// Seconds since 1970 as 32.32 fixed point; a time before 1970 is none.
std::uint64_t timestamp_of(HostTime time);

std::string transform_body(const Rigid3& reference_from_body);
/// Names are cut to 20 bytes. Every tool is written as one with six degrees of freedom.
std::string tdata_body(const std::vector<ToolPose>& tools);
/// RTS_TDATA: whether the request is granted.
std::string tracking_reply_body(bool granted);
std::string status_body(std::uint16_t code, std::int64_t subcode, std::string name, std::string_view text);
/// One slice, a pixel a millimetre, its centre at the origin.
std::string image_body(const Image8& image);
/// Vertices in single precision, as the message has them; triangles as polygons.
std::string polydata_body(const TriangleMesh& mesh);

}  // namespace gnathion::igtl
