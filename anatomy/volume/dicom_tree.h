// A DICOM file's elements as a tree of spans into its bytes.
//
// Read here and not by the library that decodes the pixels, because that one stops the program at files that
// are damaged in certain ways.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"

namespace gnathion {

struct DicomNode {
  struct Element {
    std::string_view value;                   ///< as in the file; empty for sequences without a length
    std::vector<DicomNode> items;             ///< of a sequence
    std::vector<std::string_view> fragments;  ///< of compressed pixels, the offset table first
  };
  std::map<std::uint32_t, Element> elements;  ///< by group << 16 | element
  const Element* find(std::uint32_t group, std::uint32_t element) const {
    const auto found = elements.find(group << 16 | element);
    return found == elements.end() ? nullptr : &found->second;
  }
};

/// Refers to the bytes that it was read from.
struct DicomTree {
  DicomNode root;
  std::string transfer_syntax;
  bool big_endian = false;
  std::string inflated;  ///< what a deflated file holds; the tree then refers to it
  DicomTree() = default;
  DicomTree(DicomTree&&) = default;
  DicomTree& operator=(DicomTree&&) = default;
  DicomTree(const DicomTree&) = delete;
};

/// Refuses structure that lies: lengths beyond the file, nesting without end, elements without a type.
Result<DicomTree> parse_dicom_tree(std::string_view bytes, const std::string& name);

}  // namespace gnathion
