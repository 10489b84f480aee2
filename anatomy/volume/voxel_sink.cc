#include "anatomy/volume/voxel_sink.h"

#include <cstring>
#include <limits>
#include <type_traits>

namespace gnathion {

std::size_t bytes_of(VoxelType type) {
  switch (type) {
    case VoxelType::kInt8:
    case VoxelType::kUint8:
      return 1;
    case VoxelType::kInt16:
    case VoxelType::kUint16:
      return 2;
    case VoxelType::kInt32:
    case VoxelType::kUint32:
    case VoxelType::kFloat:
      return 4;
    case VoxelType::kDouble:
      return 8;
  }
  return 1;
}

VoxelSink::VoxelSink(Volume& volume, VoxelType type, bool big_endian, std::size_t count)
    : volume_(volume), type_(type), swap_(big_endian && bytes_of(type) > 1), count_(count) {
  volume_.voxels16.clear();
  volume_.voxels.clear();
  volume_.voxels16.reserve(count);
}

void VoxelSink::widen() {
  volume_.voxels.reserve(count_);
  volume_.voxels.assign(volume_.voxels16.begin(), volume_.voxels16.end());
  std::vector<std::int16_t>().swap(volume_.voxels16);
}

template <class T>
void VoxelSink::put(T value) {
  if constexpr (std::is_floating_point_v<T>) {
    if (!std::isfinite(value)) {
      ++not_finite_;
      value = 0;
    }
  }
  if (volume_.voxels.empty()) {
    if constexpr (std::is_same_v<T, std::uint16_t>) {
      volume_.voxels16.push_back(static_cast<std::int16_t>(static_cast<int>(value) - 32768));
      return;
    }
    bool fits = true;
    if constexpr (sizeof(T) > 2)
      fits = value >= T{0} || std::is_signed_v<T>
                 ? static_cast<double>(value) >= -32768.0 && static_cast<double>(value) <= 32767.0
                 : false;
    if constexpr (std::is_floating_point_v<T>) fits = fits && value == std::floor(value);
    if (fits) {
      volume_.voxels16.push_back(static_cast<std::int16_t>(value));
      return;
    }
    widen();
  }
  const double limit = static_cast<double>(std::numeric_limits<float>::max());
  volume_.voxels.push_back(static_cast<float>(std::clamp(static_cast<double>(value), -limit, limit)));
}

template <class T>
void VoxelSink::append(const char* bytes, std::size_t voxels) {
  for (std::size_t v = 0; v < voxels; ++v) {
    T value;
    std::memcpy(&value, bytes + v * sizeof(T), sizeof(T));
    put(value);
  }
}

bool VoxelSink::take(std::string_view bytes) {
  const std::size_t size = bytes_of(type_);
  while (!bytes.empty() && taken_ < count_) {
    const char* from = bytes.data();
    std::size_t voxels = std::min(bytes.size() / size, count_ - taken_);
    std::size_t used = voxels * size;
    if (partial_size_ > 0 || voxels == 0) {  // a voxel over the border of two pieces
      used = std::min(size - partial_size_, bytes.size());
      std::memcpy(partial_ + partial_size_, from, used);
      partial_size_ += used;
      bytes.remove_prefix(used);
      if (partial_size_ < size) break;
      partial_size_ = 0;
      from = partial_;
      voxels = 1;
      used = 0;
    }
    if (swap_) {
      swapped_.assign(from, from + voxels * size);
      for (std::size_t v = 0; v < voxels; ++v)
        std::reverse(swapped_.begin() + static_cast<std::ptrdiff_t>(v * size),
                     swapped_.begin() + static_cast<std::ptrdiff_t>((v + 1) * size));
      from = swapped_.data();
    }
    switch (type_) {
      case VoxelType::kInt8:
        append<std::int8_t>(from, voxels);
        break;
      case VoxelType::kUint8:
        append<std::uint8_t>(from, voxels);
        break;
      case VoxelType::kInt16:
        append<std::int16_t>(from, voxels);
        break;
      case VoxelType::kUint16:
        append<std::uint16_t>(from, voxels);
        break;
      case VoxelType::kInt32:
        append<std::int32_t>(from, voxels);
        break;
      case VoxelType::kUint32:
        append<std::uint32_t>(from, voxels);
        break;
      case VoxelType::kFloat:
        append<float>(from, voxels);
        break;
      case VoxelType::kDouble:
        append<double>(from, voxels);
        break;
    }
    taken_ += voxels;
    bytes.remove_prefix(used);
  }
  return taken_ < count_;
}

void VoxelSink::finish(double slope, double intercept) {
  volume_.slope = slope;
  volume_.intercept = intercept;
  if (type_ == VoxelType::kUint16 && volume_.voxels.empty()) volume_.intercept += 32768.0 * slope;
}

}  // namespace gnathion
