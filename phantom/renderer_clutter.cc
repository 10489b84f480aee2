#include <algorithm>
#include <array>
#include <cmath>

#include "core/random.h"
#include "phantom/renderer_layers.h"

namespace gnathion::render {
namespace {

/// A rotated rectangle with its own coordinates: (0, 0) centre, half axes in px.
struct Board {
  double cx, cy, half_width, half_height, angle_rad;
};

/// Paints level(u, v) wherever it is not negative; (u, v) are px along the board's axes. 3×3 samples.
template <class Level>
void paint(Canvas& canvas, const Board& board, const Level& level) {
  const double c = std::cos(board.angle_rad), s = std::sin(board.angle_rad);
  const double reach_x = std::abs(c) * board.half_width + std::abs(s) * board.half_height + 1;
  const double reach_y = std::abs(s) * board.half_width + std::abs(c) * board.half_height + 1;
  Window window{static_cast<int>(board.cx - reach_x), static_cast<int>(board.cy - reach_y),
                static_cast<int>(board.cx + reach_x) + 1, static_cast<int>(board.cy + reach_y) + 1};
  window.clip(canvas.width, canvas.height);
  for (int y = window.y0; y < window.y1; ++y) {
    float* row = canvas.row(y);
    for (int x = window.x0; x < window.x1; ++x) {
      double sum = 0;
      for (int k = 0; k < 9; ++k) {
        const double dx = x + (k % 3 - 1) / 3.0 - board.cx, dy = y + (k / 3 - 1) / 3.0 - board.cy;
        const double u = c * dx + s * dy, v = -s * dx + c * dy;
        const bool inside = std::abs(u) <= board.half_width && std::abs(v) <= board.half_height;
        const double painted = inside ? level(u, v) : -1.0;
        sum += painted >= 0 ? painted : row[x];
      }
      row[x] = static_cast<float>(sum / 9);
    }
  }
}

Board random_board(Random& random, const Canvas& canvas, double smallest, double largest, double tilt_rad) {
  return {random.uniform(0, canvas.width), random.uniform(0, canvas.height),
          random.uniform(smallest, largest), random.uniform(smallest, largest),
          random.uniform(-tilt_rad, tilt_rad)};
}

/// Uneven light on a wall.
void paint_wall(Canvas& canvas, Random& random) {
  const double base = random.uniform(95, 125), slope_x = random.uniform(-35, 35),
               slope_y = random.uniform(-45, -15);
  std::array<std::array<double, 4>, 5> waves;
  for (auto& w : waves)
    w = {random.uniform(-0.012, 0.012), random.uniform(-0.012, 0.012), random.uniform(0, 6.3),
         random.uniform(2, 6)};
  for (int y = 0; y < canvas.height; ++y) {
    float* row = canvas.row(y);
    for (int x = 0; x < canvas.width; ++x) {
      double level =
          base + slope_x * (double(x) / canvas.width - 0.5) + slope_y * (double(y) / canvas.height - 0.5);
      for (const auto& w : waves) level += w[3] * std::sin(w[0] * x + w[1] * y + w[2]);
      row[x] = static_cast<float>(level);
    }
  }
}

/// Cupboards, a window, cables, a lamp.
void paint_furniture(Canvas& canvas, Random& random) {
  for (int i = 0; i < 9; ++i) {
    const Board board = random_board(random, canvas, 40, 210, 0.12);
    const double level = random.uniform(35, 200), edge = level * 0.7;
    const double shading = random.uniform(-0.1, 0.1);
    paint(canvas, board, [&](double u, double v) {
      const bool rim = board.half_width - std::abs(u) < 3 || board.half_height - std::abs(v) < 3;
      return rim ? edge : level + shading * u;
    });
  }
  for (int i = 0; i < 12; ++i) {
    Board cable = random_board(random, canvas, 1, 4, M_PI);
    cable.half_width = random.uniform(80, 420);
    const double level = random.uniform(15, 215);
    paint(canvas, cable, [&](double, double) { return level; });
  }
  for (int i = 0; i < 8; ++i) {
    Board disc = random_board(random, canvas, 8, 55, 0);
    disc.half_height = disc.half_width;
    const double level = random.uniform(30, 225), r2 = disc.half_width * disc.half_width;
    paint(canvas, disc, [&](double u, double v) { return u * u + v * v <= r2 ? level : -1.0; });
  }
}

/// Posters: rows of made-up letters on white.
void paint_print(Canvas& canvas, Random& random) {
  for (int poster = 0; poster < 5; ++poster) {
    const Board board = random_board(random, canvas, 45, 110, 0.3);
    const double stroke = random.uniform(1.6, 3.5), paper = random.uniform(170, 215),
                 ink = random.uniform(20, 60);
    std::vector<std::uint32_t> glyphs(512);
    for (auto& g : glyphs) g = random.next_u32();
    paint(canvas, board, [&](double u, double v) {
      const int column = static_cast<int>((u + board.half_width) / stroke) - 2;
      const int line = static_cast<int>((v + board.half_height) / stroke) - 2;
      const bool margin = column < 0 || line < 0 || board.half_width - u < 2 * stroke;
      if (margin || column % 4 == 3 || line % 8 >= 5) return paper;  // 3 × 5 dots a letter
      const std::uint32_t glyph = glyphs[size_t((column / 4) * 37 + (line / 8) * 101) % glyphs.size()];
      if (glyph % 6 == 0) return paper;  // a space
      return (glyph >> (8 + column % 4 + 3 * (line % 8))) & 1u ? ink : paper;
    });
  }
}

/// Squares with a dark rim and random modules: quads that a detector must look at and refuse.
void paint_false_tags(Canvas& canvas, Random& random) {
  for (int i = 0; i < 5; ++i) {
    Board board = random_board(random, canvas, 22, 45, M_PI);
    board.half_height = board.half_width;
    const double module = board.half_width / 5;
    std::array<std::uint32_t, 36> bits;
    for (auto& bit : bits) bit = random.below(2);
    paint(canvas, board, [&](double u, double v) {
      const int column = static_cast<int>(std::floor(u / module)) + 5,
                row = static_cast<int>(std::floor(v / module)) + 5;
      const int inner_column = column - 2, inner_row = row - 2;
      if (column <= 0 || row <= 0 || column >= 9 || row >= 9) return 205.0;
      if (inner_column < 0 || inner_row < 0 || inner_column > 5 || inner_row > 5) return 28.0;
      return bits[size_t(inner_row * 6 + inner_column)] ? 205.0 : 28.0;
    });
  }
}

/// Plaster, cloth, dust: fixed texture of a few grey levels, 3 px grain.
void add_texture(Canvas& canvas, Random& random) {
  constexpr int kGrain = 3, kSide = 64;
  std::vector<float> lattice(kSide * kSide);
  for (float& v : lattice) v = static_cast<float>(2.2 * random.normal());
  const auto at = [&](int i, int j) {
    return lattice[size_t((j * 7 + i + (j / kSide) * 13) & (kSide - 1)) + size_t(j & (kSide - 1)) * kSide];
  };
  for (int y = 0; y < canvas.height; ++y)
    for (int x = 0; x < canvas.width; ++x) {
      const int i = x / kGrain, j = y / kGrain;
      const float a = float(x % kGrain) / kGrain, b = float(y % kGrain) / kGrain;
      const float top = at(i, j) * (1 - a) + at(i + 1, j) * a,
                  bottom = at(i, j + 1) * (1 - a) + at(i + 1, j + 1) * a;
      canvas.row(y)[x] += top * (1 - b) + bottom * b;
    }
}

}  // namespace

Canvas clutter(int width, int height, std::uint64_t seed) {
  Random random(seed, 0x726f6f6d);
  Canvas canvas(width, height);
  paint_wall(canvas, random);
  paint_furniture(canvas, random);
  paint_print(canvas, random);
  paint_false_tags(canvas, random);
  add_texture(canvas, random);
  return canvas;
}

}  // namespace gnathion::render
