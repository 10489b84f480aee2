// Text that goes into XML, SVG and HTML.
#pragma once

#include <string>
#include <string_view>

namespace gnathion {

/// With & < > " ' as entities: safe between tags and inside quoted attributes. Control characters that
/// XML 1.0 forbids become U+FFFD.
std::string xml_escaped(std::string_view text);

/// RFC 4648, padded.
std::string base64(std::string_view bytes);

}  // namespace gnathion
