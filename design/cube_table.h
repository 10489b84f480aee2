// Marching cubes with a table made by rule instead of by hand.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace gnathion {

/// Corner c of a cube lies at (c & 1, c >> 1 & 1, c >> 2 & 1). Edge e runs along axis e / 4 from
/// cube_edges()[e][0].
struct CubeCase {
  /// Triangles as triples of edges; 12 stands for the centre of the loop that follows.
  std::vector<std::array<std::uint8_t, 3>> triangles;
};

const std::array<std::array<std::uint8_t, 2>, 12>& cube_edges();

/// The 256 cases; bit c of the index is set where corner c is inside. On an ambiguous face the two inside
/// corners are kept apart, a rule that both cubes of the face obey: the surface is closed, each vertex has
/// one fan, and no diagonal lies in a face, so that no edge gets four triangles. Counter-clockwise seen from
/// outside.
const std::array<CubeCase, 256>& cube_table();

}  // namespace gnathion
