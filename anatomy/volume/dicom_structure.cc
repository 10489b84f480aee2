// Looks over a DICOM file's lengths before a library believes them: a wrong one asks for gigabytes, or lies
// about what was cut off. Source: DICOM PS3.5, chapter 7 (data elements, sequences, encapsulated pixels).
#include <fmt/format.h>

#include <cstring>

#include "anatomy/volume/dicom_file.h"
#include "anatomy/volume/dicom_tree.h"
#include "anatomy/volume/inflate.h"
#include "anatomy/volume/volume_checks.h"

namespace gnathion {
namespace {

constexpr std::uint32_t kUndefined = 0xffffffffu;
constexpr int kDeepest = 24;
constexpr std::uint64_t kLargestInflated = std::uint64_t{2} << 30;

/// Value representations of PS3.5, table 6.2-1.
bool known_vr(const char* vr) {
  static constexpr std::string_view kAll =
      "AE AS AT CS DA DS DT FD FL IS LO LT OB OD OF OL OV OW PN SH SL SQ SS ST SV TM UC UI UL UN UR US UT "
      "UV ";
  for (std::size_t i = 0; i < kAll.size(); i += 3)
    if (kAll[i] == vr[0] && kAll[i + 1] == vr[1]) return true;
  return false;
}

class Walker {
 public:
  Walker(std::string_view bytes, bool explicit_vr, bool big)
      : bytes_(bytes), explicit_(explicit_vr), big_(big) {}

  /// The reason why not, or nothing.
  std::string walk(std::size_t at, DicomNode& root) {
    elements(at, bytes_.size(), explicit_, 0, false, root);
    return why_;
  }

 private:
  std::uint32_t u16(std::size_t at) const {
    const auto a = static_cast<unsigned char>(bytes_[at]), b = static_cast<unsigned char>(bytes_[at + 1]);
    return big_ ? static_cast<std::uint32_t>(a << 8 | b) : static_cast<std::uint32_t>(b << 8 | a);
  }
  std::uint32_t u32(std::size_t at) const {
    return big_ ? u16(at) << 16 | u16(at + 2) : u16(at + 2) << 16 | u16(at);
  }
  std::size_t stop(const std::string& why) {
    if (why_.empty()) why_ = why;
    return bytes_.size();
  }
  std::size_t cut(std::uint32_t group, std::uint32_t element, std::uint64_t length, std::size_t left) {
    const bool pixels = group == 0x7fe0;
    return stop(
        pixels ? fmt::format("truncated: its pixels take {} bytes, {} are there", length, left)
               : fmt::format("truncated or damaged: element ({:04x},{:04x}) takes {} bytes, {} are there",
                             group, element, length, left));
  }

  static bool long_form(const char* vr) {
    for (const char* v : {"OB", "OW", "OF", "OD", "OL", "OV", "SQ", "UC", "UR", "UT", "UN", "SV", "UV"})
      if (std::memcmp(vr, v, 2) == 0) return true;
    return false;
  }

  /// Elements up to `end`, or, in an item without a length, up to its delimiter. Returns where they end.
  std::size_t elements(std::size_t at, std::size_t end, bool explicit_vr, int depth, bool delimited,
                       DicomNode& node) {
    if (depth > kDeepest) return stop("damaged: its sequences are nested without end");
    while (at + 8 <= end && why_.empty()) {
      const std::uint32_t group = u16(at), element = u16(at + 2);
      if (depth == 0 && group == 0 && bytes_.find_first_not_of('\0', at) == std::string_view::npos)
        return end;  // padded with zeros
      if (group == 0xfffe) {
        if (element == 0xe00d && delimited) return at + 8;
        return stop("damaged: an item stands outside a sequence");
      }
      std::size_t value = at + 8;
      std::uint32_t length;
      bool sequence = false, unknown = false;
      if (explicit_vr) {
        const char* vr = bytes_.data() + at + 4;
        if (!known_vr(vr))
          return stop(
              fmt::format("damaged: element ({:04x},{:04x}) has no value representation", group, element));
        sequence = std::memcmp(vr, "SQ", 2) == 0;
        unknown = std::memcmp(vr, "UN", 2) == 0;
        if (long_form(vr)) {
          if (at + 12 > end) return cut(group, element, 12, end - at);
          length = u32(at + 8);
          value = at + 12;
        } else {
          length = u16(at + 6);
        }
      } else {
        length = u32(at + 4);
      }
      DicomNode::Element& own = node.elements[group << 16 | element];
      if (length == kUndefined) {
        at = group == 0x7fe0 && element == 0x10 ? fragments(value, end, own)
                                                : items(value, end, explicit_vr && !unknown, depth, own);
        continue;
      }
      if (length > end - value) return cut(group, element, length, end - value);
      own.value = bytes_.substr(value, length);
      const bool known_sequence = sequence || (!explicit_ && is_sequence(group, element));
      if (known_sequence) items(value, value + length, explicit_vr, depth, own);
      at = value + length;
    }
    if (why_.empty() && delimited) return stop("truncated: a sequence does not end");
    return at;
  }

  /// Implicit files do not say which elements are sequences; of those with a length, these are needed.
  static bool is_sequence(std::uint32_t group, std::uint32_t element) {
    return (group == 0x5200 && (element == 0x9229 || element == 0x9230)) ||
           (group == 0x0020 && (element == 0x9113 || element == 0x9116)) ||
           (group == 0x0028 && (element == 0x9110 || element == 0x9145));
  }

  std::size_t items(std::size_t at, std::size_t end, bool explicit_vr, int depth,
                    DicomNode::Element& sequence) {
    while (at + 8 <= end && why_.empty()) {
      const std::uint32_t group = u16(at), element = u16(at + 2), length = u32(at + 4);
      at += 8;
      if (group == 0xfffe && element == 0xe0dd) return at;
      if (group != 0xfffe || element != 0xe000)
        return stop("damaged: a sequence holds something else than items");
      if (length == kUndefined) {
        at = elements(at, end, explicit_vr, depth + 1, true, sequence.items.emplace_back());
      } else {
        if (length > end - at) return cut(group, element, length, end - at);
        elements(at, at + length, explicit_vr, depth + 1, false, sequence.items.emplace_back());
        at += length;
      }
    }
    return at;
  }

  std::size_t fragments(std::size_t at, std::size_t end, DicomNode::Element& pixels) {
    while (at + 8 <= end && why_.empty()) {
      const std::uint32_t group = u16(at), element = u16(at + 2), length = u32(at + 4);
      at += 8;
      if (group == 0xfffe && element == 0xe0dd) return at;
      if (group != 0xfffe || element != 0xe000)
        return stop("damaged: its compressed pixels hold something else");
      if (length > end - at) return cut(0x7fe0, 0x10, length, end - at);
      pixels.fragments.push_back(bytes_.substr(at, length));
      at += length;
    }
    return stop("truncated: its compressed pixels do not end");
  }

  std::string_view bytes_;
  bool explicit_, big_;
  std::string why_;
};

/// Transfer syntax and where the data set begins, from the file meta information.
struct Meta {
  std::string syntax, why;
  std::size_t data = 0;
};
Meta read_meta(std::string_view bytes) {
  Meta meta;
  std::size_t at = 132;
  const auto u16 = [&](std::size_t i) {
    return static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i]) |
                                      static_cast<unsigned char>(bytes[i + 1]) << 8);
  };
  std::uint32_t last = 0;
  while (at + 8 <= bytes.size() && u16(at) == 2) {
    const std::uint32_t element = u16(at + 2);
    const char* vr = bytes.data() + at + 4;
    if (!known_vr(vr) || (at > 132 && element <= last)) {
      meta.why = "damaged within its header";
      return meta;
    }
    last = element;
    const bool is_long = std::memcmp(vr, "OB", 2) == 0 || std::memcmp(vr, "UN", 2) == 0;
    const std::size_t value = at + (is_long ? 12 : 8);
    if (value > bytes.size()) break;
    const std::uint64_t length =
        is_long ? u16(at + 8) | static_cast<std::uint64_t>(u16(at + 10)) << 16 : u16(at + 6);
    if (length > bytes.size() - value) {
      meta.why = "truncated within its header";
      return meta;
    }
    if (element == 0x10) {
      meta.syntax = std::string(bytes.substr(value, length));
      while (!meta.syntax.empty() && (meta.syntax.back() == '\0' || meta.syntax.back() == ' '))
        meta.syntax.pop_back();
    }
    at = value + length;
  }
  meta.data = at;
  if (meta.syntax.empty()) meta.why = "truncated or damaged: no transfer syntax";
  return meta;
}

bool contains(std::string_view in, std::string_view what) {
  return in.find(what) != std::string_view::npos;
}

}  // namespace

DicomKind dicom_kind(std::string_view first, const std::string& file_name) {
  if (first.size() >= 132 && first.substr(128, 4) == "DICM") {
    std::string upper = file_name;
    for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
    return upper == "DICOMDIR" ? DicomKind::kDirectory : DicomKind::kDicom;
  }
  // PKCS #7 / CMS: 1.2.840.113549.1.7.x near the start (DICOM PS3.15 B.1 wraps whole files in it).
  static constexpr char kCms[] = "\x2a\x86\x48\x86\xf7\x0d\x01\x07";
  if (first.size() > 20 && first[0] == '\x30' && contains(first.substr(0, 64), std::string_view(kCms, 8)))
    return DicomKind::kEncrypted;
  if (first.size() > 8 && first.substr(0, 8) == "Salted__") return DicomKind::kEncrypted;
  if (first.size() > 8 && first.substr(0, 4) == std::string_view("PK\3\4", 4) && (first[6] & 1) != 0)
    return DicomKind::kEncrypted;
  return DicomKind::kNot;
}

Result<DicomTree> parse_dicom_tree(std::string_view bytes, const std::string& name) {
  if (dicom_kind(bytes, name) != DicomKind::kDicom) return bad_input(kReadVolume, name, "not a DICOM file");
  const Meta meta = read_meta(bytes);
  if (!meta.why.empty()) return bad_input(kReadVolume, name, meta.why);
  DicomTree tree;
  tree.transfer_syntax = meta.syntax;
  std::string why;
  if (meta.syntax == "1.2.840.10008.1.2.1.99") {
    tree.inflated.reserve(4 * bytes.size());
    why =
        unpack(bytes.substr(meta.data), Packing::kRawDeflate, kLargestInflated, [&](std::string_view piece) {
          tree.inflated += piece;
          return true;
        });
    why = why.empty() ? Walker(tree.inflated, true, false).walk(0, tree.root) : "deflated: " + why;
  } else {
    tree.big_endian = meta.syntax == "1.2.840.10008.1.2.2";
    why = Walker(bytes, meta.syntax != "1.2.840.10008.1.2", tree.big_endian).walk(meta.data, tree.root);
  }
  if (!why.empty()) return bad_input(kReadVolume, name, why);
  return tree;
}

Status check_dicom_structure(std::string_view bytes, const std::string& name) {
  GNATHION_TRY(const DicomTree tree, parse_dicom_tree(bytes, name));
  return {};
}

}  // namespace gnathion
