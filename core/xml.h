// Text that goes into XML, SVG and HTML.
#pragma once

#include <string>
#include <string_view>

namespace gnathion {

/// The text with every byte that is not part of a UTF-8 character as U+FFFD: names of files can hold
/// anything.
std::string valid_utf8(std::string_view text);

/// Valid UTF-8 with & < > " ' as entities: safe between tags and inside quoted attributes. Control characters
/// that XML 1.0 forbids become U+FFFD.
std::string xml_escaped(std::string_view text);

/// RFC 4648, padded.
std::string base64(std::string_view bytes);

}  // namespace gnathion
