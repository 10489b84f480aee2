// NIfTI-1 single files (.nii, .nii.gz). Source: the format's own header, nifti1.h (NIfTI DFWG, 2003-2011).
//
// A reader of its own, because vtkNIFTIImageReader leaves sform and qform beside the image and flips its
// slices to make the map right-handed: the map is what matters here.
#include <fmt/format.h>

#include <cstring>
#include <optional>

#include "anatomy/volume/inflate.h"
#include "anatomy/volume/volume_checks.h"
#include "anatomy/volume/voxel_sink.h"

namespace gnathion {
namespace {

constexpr std::size_t kHeaderBytes = 348;

/// Fields by their offset in the header, in either byte order.
class Header {
 public:
  Header(const char* bytes, bool swap) : bytes_(bytes), swap_(swap) {}
  template <class T>
  T at(std::size_t offset) const {
    char raw[sizeof(T)];
    std::memcpy(raw, bytes_ + offset, sizeof(T));
    if (swap_) std::reverse(raw, raw + sizeof(T));
    T value;
    std::memcpy(&value, raw, sizeof(T));
    return value;
  }
  int dim(int k) const { return at<std::int16_t>(40 + 2 * static_cast<std::size_t>(k)); }
  double pixdim(int k) const { return static_cast<double>(at<float>(76 + 4 * static_cast<std::size_t>(k))); }

 private:
  const char* bytes_;
  bool swap_;
};

std::optional<VoxelType> type_of(int code) {
  switch (code) {
    case 2:
      return VoxelType::kUint8;
    case 4:
      return VoxelType::kInt16;
    case 8:
      return VoxelType::kInt32;
    case 16:
      return VoxelType::kFloat;
    case 64:
      return VoxelType::kDouble;
    case 256:
      return VoxelType::kInt8;
    case 512:
      return VoxelType::kUint16;
    case 768:
      return VoxelType::kUint32;
    default:
      return {};
  }
}

VoxelGrid by_sform(const Header& h) {
  VoxelGrid g;
  for (int row = 0; row < 3; ++row) {
    const std::size_t at = 280 + 16 * static_cast<std::size_t>(row);
    for (int column = 0; column < 3; ++column)
      g.step_mm(row, column) = static_cast<double>(h.at<float>(at + 4 * static_cast<std::size_t>(column)));
    g.origin_mm[row] = static_cast<double>(h.at<float>(at + 12));
  }
  return g;
}

VoxelGrid by_qform(const Header& h) {
  const double b = static_cast<double>(h.at<float>(256)), c = static_cast<double>(h.at<float>(260)),
               d = static_cast<double>(h.at<float>(264));
  const double a = std::sqrt(std::max(0.0, 1.0 - b * b - c * c - d * d));
  const double side = h.pixdim(0) < 0.0 ? -1.0 : 1.0;  // qfac
  VoxelGrid g;
  g.step_mm = Eigen::Quaterniond(a, b, c, d).normalized().toRotationMatrix() *
              Vector3(h.pixdim(1), h.pixdim(2), side * h.pixdim(3)).asDiagonal();
  g.origin_mm = {static_cast<double>(h.at<float>(268)), static_cast<double>(h.at<float>(272)),
                 static_cast<double>(h.at<float>(276))};
  return g;
}

/// Largest distance between what two maps say of the volume's corners.
double disagreement_mm(const VoxelGrid& a, const VoxelGrid& b, const std::array<int, 3>& size) {
  double most = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Vector3 ijk((corner & 1) * (size[0] - 1), (corner >> 1 & 1) * (size[1] - 1),
                      (corner >> 2 & 1) * (size[2] - 1));
    most = std::max(most, (a.frame_from_voxel(ijk) - b.frame_from_voxel(ijk)).norm());
  }
  return most;
}

/// The voxels' map in the file's unit, RAS.
Result<VoxelGrid> map_of(const Header& h, const std::array<int, 3>& size, const std::string& name,
                         std::vector<std::string>& warnings) {
  const bool has_s = h.at<std::int16_t>(254) > 0, has_q = h.at<std::int16_t>(252) > 0;
  const VoxelGrid s = by_sform(h), q = by_qform(h);
  VoxelGrid grid;
  if (has_s) {
    grid = s;
    if (has_q) {
      const double apart = disagreement_mm(s, q, size);
      if (apart > 0.5 * q.spacing_mm().minCoeff())
        warnings.push_back(
            fmt::format("sform and qform differ by up to {:.3g} mm; the sform is taken", apart));
    }
  } else if (has_q) {
    grid = q;
  } else {
    grid.step_mm = Vector3(h.pixdim(1), h.pixdim(2), h.pixdim(3)).asDiagonal();
    warnings.push_back(
        "neither sform nor qform: nothing says where left and right are; rows are taken as from left to "
        "right");
  }
  if (!grid.step_mm.allFinite() || std::abs(grid.step_mm.determinant()) < 1e-15)
    return bad_input(kReadVolume, name, "its sform or qform is singular");
  return grid;
}

/// Millimetres in the header's unit; unit 0 is "unknown", taken as mm and checked by size.
double mm_per_unit(int units) {
  switch (units & 7) {
    case 1:
      return 1000.0;
    case 3:
      return 0.001;
    default:
      return 1.0;
  }
}

}  // namespace

Result<VolumeFile> parse_nifti(const std::string& bytes, const std::string& name,
                               const ReadVolumeOptions& options) {
  const bool packed = bytes.size() > 2 && bytes[0] == '\x1f' && static_cast<unsigned char>(bytes[1]) == 0x8b;
  std::string start;
  if (packed) {
    const std::string why =
        unpack(bytes, Packing::kGzip, std::uint64_t{1} << 40, [&](std::string_view piece) {
          start.append(piece.substr(0, kHeaderBytes - std::min(start.size(), kHeaderBytes)));
          return start.size() < kHeaderBytes;
        });
    if (!why.empty()) return bad_input(kReadVolume, name, "gzip: " + why);
  } else {
    start = bytes.substr(0, kHeaderBytes);
  }
  if (start.size() < kHeaderBytes) return bad_input(kReadVolume, name, "truncated: no NIfTI header");
  std::int32_t header_size;
  std::memcpy(&header_size, start.data(), 4);
  const bool swap = header_size != 348;
  const Header h(start.data(), swap);
  if (h.at<std::int32_t>(0) != 348)
    return bad_input(kReadVolume, name,
                     h.at<std::int32_t>(0) == 540 ? "NIfTI-2 is not read, NIfTI-1 is" : "not NIfTI");
  if (std::memcmp(start.data() + 344, "ni1", 3) == 0)
    return bad_input(kReadVolume, name, "a header whose voxels are in another file: save as one .nii");
  if (std::memcmp(start.data() + 344, "n+1", 3) != 0) return bad_input(kReadVolume, name, "not NIfTI");

  VolumeFile out;
  VolumeInfo& info = out.info;
  info.format = "NIfTI";
  info.files = 1;
  if (h.dim(0) < 3 || h.dim(0) > 7)
    return bad_input(kReadVolume, name, fmt::format("{} dimensions, not 3", h.dim(0)));
  for (int k = 4; k <= h.dim(0); ++k)
    if (h.dim(k) > 1)
      return bad_input(kReadVolume, name,
                       "several volumes over time or vectors in one file; one volume is needed");
  const std::array<int, 3> size{h.dim(1), h.dim(2), h.dim(3)};
  const auto type = type_of(h.at<std::int16_t>(70));
  if (!type)
    return bad_input(kReadVolume, name,
                     fmt::format("voxels of NIfTI type {} are not read", h.at<std::int16_t>(70)));

  GNATHION_TRY(VoxelGrid grid, map_of(h, size, name, info.warnings));
  const double unit_mm = mm_per_unit(h.at<char>(123));
  if (unit_mm != 1.0)
    info.warnings.push_back(unit_mm > 1.0
                                ? "units in metres, as its header says; turned into millimetres"
                                : "units in micrometres, as its header says; turned into millimetres");
  const Matrix3 lps_from_ras = Vector3(-unit_mm, -unit_mm, unit_mm).asDiagonal();
  grid.step_mm = (lps_from_ras * grid.step_mm).eval();
  grid.origin_mm = (lps_from_ras * grid.origin_mm).eval();
  grid.size = size;
  const bool wide = *type == VoxelType::kFloat || *type == VoxelType::kDouble;
  GNATHION_CHECK_OK(check_grid(grid, wide ? 4 : 2, options.largest_bytes, name, info.warnings));
  out.volume.grid = info.grid = grid;

  const double offset = static_cast<double>(h.at<float>(108));
  if (!(offset >= 348.0) || offset > 1e9)
    return bad_input(kReadVolume, name, "its voxels start within the header");
  std::size_t skip = static_cast<std::size_t>(offset);
  // A packed file cannot hold more than about a thousand times its size; an unpacked one holds what it holds.
  const double needed = static_cast<double>(grid.count() * bytes_of(*type)) + offset;
  if (needed > static_cast<double>(bytes.size()) * (packed ? 1100.0 : 1.0) + 1.0)
    return bad_input(kReadVolume, name, fmt::format("truncated: {:.0f} bytes announced", needed));
  VoxelSink sink(out.volume, *type, swap, grid.count());
  const auto take = [&](std::string_view piece) {
    const std::size_t drop = std::min(skip, piece.size());
    skip -= drop;
    return sink.take(piece.substr(drop));
  };
  if (packed) {
    const std::string why = unpack(bytes, Packing::kGzip, std::uint64_t{1} << 40, take);
    if (!why.empty()) return bad_input(kReadVolume, name, "gzip: " + why);
  } else {
    take(bytes);
  }
  if (!sink.complete())
    return bad_input(kReadVolume, name,
                     fmt::format("truncated: {} of {} voxels are there", sink.taken(), grid.count()));
  if (sink.not_finite() > 0)
    info.warnings.push_back(fmt::format("{} voxels are not numbers; they count as 0", sink.not_finite()));
  double slope = static_cast<double>(h.at<float>(112)), intercept = static_cast<double>(h.at<float>(116));
  if (!std::isfinite(slope) || slope == 0.0 || !std::isfinite(intercept)) slope = 1.0, intercept = 0.0;
  sink.finish(slope, intercept);
  return out;
}

}  // namespace gnathion
