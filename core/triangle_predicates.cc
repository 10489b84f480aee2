#include "core/triangle_predicates.h"

#include <array>
#include <cmath>
#include <limits>

namespace gnathion {
namespace {

constexpr double kUlp = std::numeric_limits<double>::epsilon() / 2.0;  // 2^-53
constexpr double kBound3d = (7.0 + 56.0 * kUlp) * kUlp;
constexpr double kBound2d = (3.0 + 16.0 * kUlp) * kUlp;

/// An exact real number as a sum of doubles that do not overlap, smallest first, without zeros.
template <int kCapacity>
struct Expansion {
  std::array<double, kCapacity> terms;
  int size = 0;

  void push(double term) {
    if (term != 0.0) terms[static_cast<std::size_t>(size++)] = term;
  }
  int sign() const {
    if (size == 0) return 0;
    return terms[static_cast<std::size_t>(size - 1)] > 0.0 ? 1 : -1;
  }
};

/// sum + error = a + b exactly (Knuth).
void two_sum(double a, double b, double& sum, double& error) {
  sum = a + b;
  const double b_part = sum - a;
  error = (a - (sum - b_part)) + (b - b_part);
}

/// product + error = a·b exactly (Dekker's halves).
void two_product(double a, double b, double& product, double& error) {
  constexpr double kSplitter = 134217729.0;  // 2^27 + 1
  const double sa = kSplitter * a, sb = kSplitter * b;
  const double a_high = sa - (sa - a), b_high = sb - (sb - b);
  const double a_low = a - a_high, b_low = b - b_high;
  product = a * b;
  error = a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low);
}

/// e + b: b is carried through the terms from the smallest on.
template <int kTo, int kFrom>
Expansion<kTo> grown(const Expansion<kFrom>& e, double b) {
  Expansion<kTo> result;
  double carry = b;
  for (int i = 0; i < e.size; ++i) {
    double sum, error;
    two_sum(carry, e.terms[static_cast<std::size_t>(i)], sum, error);
    result.push(error);
    carry = sum;
  }
  result.push(carry);
  return result;
}

template <int kA, int kB>
Expansion<kA + kB> operator+(const Expansion<kA>& a, const Expansion<kB>& b) {
  Expansion<kA + kB> sum;
  for (int i = 0; i < a.size; ++i) sum.push(a.terms[static_cast<std::size_t>(i)]);
  for (int i = 0; i < b.size; ++i) sum = grown<kA + kB>(sum, b.terms[static_cast<std::size_t>(i)]);
  return sum;
}

template <int kA>
Expansion<kA> operator-(const Expansion<kA>& a) {
  Expansion<kA> negative = a;
  for (int i = 0; i < a.size; ++i) negative.terms[static_cast<std::size_t>(i)] *= -1.0;
  return negative;
}

template <int kA, int kB>
Expansion<2 * kA * kB> operator*(const Expansion<kA>& a, const Expansion<kB>& b) {
  Expansion<2 * kA * kB> product;
  for (int i = 0; i < a.size; ++i)
    for (int j = 0; j < b.size; ++j) {
      double high, low;
      two_product(a.terms[static_cast<std::size_t>(i)], b.terms[static_cast<std::size_t>(j)], high, low);
      product = grown<2 * kA * kB>(product, low);
      product = grown<2 * kA * kB>(product, high);
    }
  return product;
}

Expansion<2> exact_difference(double a, double b) {
  Expansion<2> result;
  double sum, error;
  two_sum(a, -b, sum, error);
  result.push(error);
  result.push(sum);
  return result;
}

int exact_orient3d_sign(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) {
  const auto difference = [&](const Vector3& p, int k) { return exact_difference(p[k], d[k]); };
  const auto minor = [&](const Vector3& p, const Vector3& q) {
    return difference(p, 0) * difference(q, 1) + -(difference(q, 0) * difference(p, 1));
  };
  return (minor(b, c) * difference(a, 2) + minor(c, a) * difference(b, 2) + minor(a, b) * difference(c, 2))
      .sign();
}

int exact_orient2d_sign(const Vector3& a, const Vector3& b, const Vector3& c, int x, int y) {
  return (exact_difference(a[x], c[x]) * exact_difference(b[y], c[y]) +
          -(exact_difference(a[y], c[y]) * exact_difference(b[x], c[x])))
      .sign();
}

}  // namespace

int orient3d_filtered(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) {
  const double adx = a.x() - d.x(), ady = a.y() - d.y(), adz = a.z() - d.z();
  const double bdx = b.x() - d.x(), bdy = b.y() - d.y(), bdz = b.z() - d.z();
  const double cdx = c.x() - d.x(), cdy = c.y() - d.y(), cdz = c.z() - d.z();
  const double bc = bdx * cdy, cb = cdx * bdy, ca = cdx * ady, ac = adx * cdy, ab = adx * bdy, ba = bdx * ady;
  const double det = adz * (bc - cb) + bdz * (ca - ac) + cdz * (ab - ba);
  const double permanent = (std::abs(bc) + std::abs(cb)) * std::abs(adz) +
                           (std::abs(ca) + std::abs(ac)) * std::abs(bdz) +
                           (std::abs(ab) + std::abs(ba)) * std::abs(cdz);
  const double bound = kBound3d * permanent;
  if (det > bound) return 1;
  if (det < -bound) return -1;
  // Without any permanent every product has a zero factor, as in a plane along two axes.
  return permanent == 0.0 ? 0 : kUncertain;
}

int orient3d_sign(const Vector3& a, const Vector3& b, const Vector3& c, const Vector3& d) {
  const int sign = orient3d_filtered(a, b, c, d);
  return sign == kUncertain ? exact_orient3d_sign(a, b, c, d) : sign;
}

int orient2d_sign(const Vector3& a, const Vector3& b, const Vector3& c, int x, int y) {
  const double left = (a[x] - c[x]) * (b[y] - c[y]), right = (a[y] - c[y]) * (b[x] - c[x]);
  const double det = left - right, bound = kBound2d * (std::abs(left) + std::abs(right));
  if (det > bound) return 1;
  if (det < -bound) return -1;
  if (left == 0.0 && right == 0.0) return 0;
  return exact_orient2d_sign(a, b, c, x, y);
}

}  // namespace gnathion
