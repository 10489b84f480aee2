// Takes a file's voxels as they come and keeps them as int16 where that loses nothing, else as float.
#pragma once

#include <cstdint>
#include <string_view>

#include "anatomy/volume/volume.h"

namespace gnathion {

enum class VoxelType { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat, kDouble };
std::size_t bytes_of(VoxelType type);

/// uint16 is kept as int16 with an offset; wider types as int16 as long as all values are whole and fit.
class VoxelSink {
 public:
  /// `count` voxels of the volume's grid will come.
  VoxelSink(Volume& volume, VoxelType type, bool big_endian, std::size_t count);
  /// Any number of bytes, also parts of a voxel. Returns whether more are needed.
  bool take(std::string_view bytes);
  bool complete() const { return taken_ == count_; }
  std::size_t taken() const { return taken_; }
  std::size_t not_finite() const { return not_finite_; }  ///< values that were NaN or infinite; they are 0
  /// Applies the file's own scale. Once, when complete.
  void finish(double slope, double intercept);

 private:
  template <class T>
  void append(const char* bytes, std::size_t voxels);
  template <class T>
  void put(T value);
  void widen();

  Volume& volume_;
  VoxelType type_;
  bool swap_;
  std::size_t count_, taken_ = 0, not_finite_ = 0;
  char partial_[8] = {};
  std::size_t partial_size_ = 0;
  std::vector<char> swapped_;
};

}  // namespace gnathion
