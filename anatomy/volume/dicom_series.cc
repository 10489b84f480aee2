#include "anatomy/volume/dicom_series.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <numbers>

#include "anatomy/volume/volume_checks.h"

namespace gnathion {
namespace {

constexpr double kSamePlaceMm = 0.005;  ///< positions are decimal strings of three digits and more
constexpr double kUneven = 0.1;         ///< of the spacing: what rounded positions may show

struct Slice {
  SliceRef ref;
  const DicomHeader* file;
  const DicomPlane* plane;
  double along_mm = 0.0;
  std::string name() const {
    const std::string base = file->shown_name();
    return file->planes.size() == 1 ? base : fmt::format("{} frame {}", base, ref.plane + 1);
  }
};

/// "a.dcm, b.dcm, c.dcm and 4 more"
std::string some_of(const std::vector<std::string>& names) {
  std::string out;
  for (std::size_t i = 0; i < std::min<std::size_t>(3, names.size()); ++i) out += (i ? ", " : "") + names[i];
  if (names.size() > 3) out += fmt::format(" and {} more", names.size() - 3);
  return out;
}

bool is_localizer(const DicomHeader& h) {
  std::string type = h.image_type;
  for (char& c : type) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
  return type.find("LOCALIZER") != std::string::npos || type.find("SCOUT") != std::string::npos ||
         type.find("TOPOGRAM") != std::string::npos;
}

bool axes_are_sound(const DicomPlane& p) {
  return std::abs(p.along_row.norm() - 1.0) < 1e-3 && std::abs(p.along_column.norm() - 1.0) < 1e-3 &&
         std::abs(p.along_row.dot(p.along_column)) < 1e-3 && p.row_spacing_mm > 0.0 &&
         p.column_spacing_mm > 0.0;
}

bool alike(const Slice& a, const Slice& b) {
  return a.file->rows == b.file->rows && a.file->columns == b.file->columns &&
         (a.plane->along_row - b.plane->along_row).norm() < 2e-3 &&
         (a.plane->along_column - b.plane->along_column).norm() < 2e-3 &&
         std::abs(a.plane->row_spacing_mm - b.plane->row_spacing_mm) < 1e-4 &&
         std::abs(a.plane->column_spacing_mm - b.plane->column_spacing_mm) < 1e-4;
}

class Stacker {
 public:
  Stacker(const std::vector<DicomHeader>& files, const std::string& name, bool only_one)
      : files_(files), name_(name), only_one_(only_one) {}

  Result<SliceStack> stack() {
    GNATHION_CHECK_OK(collect());
    GNATHION_CHECK_OK(keep_largest_group());
    sort_along_normal();
    drop_twins();
    GNATHION_CHECK_OK(space_out());
    GNATHION_CHECK_OK(check_line());
    tell_tilt();
    return std::move(out_);
  }

 private:
  tl::unexpected<Error> bad(const std::string& why) const { return bad_input(kReadVolume, name_, why); }

  /// All pictures that have a place; the others are named.
  Status collect() {
    std::vector<std::string> colour, lost, crooked, localizers, empty, tables;
    for (std::size_t f = 0; f < files_.size(); ++f) {
      const DicomHeader& h = files_[f];
      const std::string base = h.shown_name();
      if (!h.has_pixels) {
        empty.push_back(base);
        continue;
      }
      if (h.samples != 1 || h.photometric.compare(0, 10, "MONOCHROME") != 0) {
        colour.push_back(base);
        continue;
      }
      if (is_localizer(h)) {
        localizers.push_back(base);
        continue;
      }
      if (h.modality_lut) {
        tables.push_back(base);
        continue;
      }
      for (std::size_t p = 0; p < h.planes.size(); ++p) {
        const Slice slice{{f, p}, &h, &h.planes[p]};
        if (!slice.plane->placed)
          lost.push_back(slice.name());
        else if (!axes_are_sound(*slice.plane))
          crooked.push_back(slice.name());
        else
          slices_.push_back(slice);
      }
    }
    if (!crooked.empty()) return bad("orientation or pixel spacing that cannot be: " + some_of(crooked));
    if (!tables.empty()) return bad("values through a table (Modality LUT) are not read: " + some_of(tables));
    const auto note = [&](const std::vector<std::string>& names, const char* why) {
      if (!names.empty()) out_.warnings.push_back(fmt::format("left out, {}: {}", why, some_of(names)));
    };
    note(localizers, "a localizer");
    note(colour, "a colour picture");
    note(lost, "nothing says where it lies");
    note(empty, "without pixels");
    if (!slices_.empty()) return {};
    if (!colour.empty()) return bad("a photograph or colour picture, no volume: " + some_of(colour));
    if (!lost.empty())
      return bad(
          "a photograph or secondary capture: nothing says where it lies or how large its pixels are: " +
          some_of(lost));
    if (!localizers.empty()) return bad("localizers only, no volume: " + some_of(localizers));
    return bad("no pictures");
  }

  Status keep_largest_group() {
    std::vector<std::vector<Slice>> groups;
    for (const Slice& s : slices_) {
      const auto found =
          std::find_if(groups.begin(), groups.end(), [&](const auto& g) { return alike(g[0], s); });
      if (found == groups.end())
        groups.push_back({s});
      else
        found->push_back(s);
    }
    std::stable_sort(groups.begin(), groups.end(),
                     [](const auto& a, const auto& b) { return a.size() > b.size(); });
    if (groups.size() > 1 && groups[1].size() > 3 && 3 * groups[1].size() > groups[0].size())
      return bad(fmt::format("its slices form {} stacks of different orientation or size ({} and {} slices)",
                             groups.size(), groups[0].size(), groups[1].size()));
    std::vector<std::string> odd;
    for (std::size_t g = 1; g < groups.size(); ++g)
      for (const Slice& s : groups[g]) odd.push_back(s.name());
    if (!odd.empty())
      out_.warnings.push_back("left out, of another orientation or size than the stack (localizers?): " +
                              some_of(odd));
    slices_ = std::move(groups[0]);
    return {};
  }

  void sort_along_normal() {
    const DicomPlane& p = *slices_[0].plane;
    normal_ = p.along_row.cross(p.along_column).normalized();
    for (Slice& s : slices_) s.along_mm = normal_.dot(s.plane->position_mm);
    // Equal places in an order that does not depend on names.
    std::stable_sort(slices_.begin(), slices_.end(), [](const Slice& a, const Slice& b) {
      if (a.along_mm != b.along_mm) return a.along_mm < b.along_mm;
      return a.file->instance_uid < b.file->instance_uid;
    });
  }

  void drop_twins() {
    std::vector<Slice> kept;
    for (const Slice& s : slices_) {
      if (!kept.empty() && s.along_mm - kept.back().along_mm < kSamePlaceMm)
        out_.twins.push_back({kept.back().ref, s.ref});
      else
        kept.push_back(s);
    }
    slices_ = std::move(kept);
  }

  /// One entry a step: pictures, and gaps where steps are multiples.
  Status space_out() {
    const DicomPlane& first = *slices_[0].plane;
    out_.grid.size = {slices_[0].file->columns, slices_[0].file->rows, static_cast<int>(slices_.size())};
    out_.grid.step_mm.col(0) = first.along_row * first.column_spacing_mm;
    out_.grid.step_mm.col(1) = first.along_column * first.row_spacing_mm;
    out_.grid.step_mm.col(2) = normal_;
    out_.grid.origin_mm = first.position_mm;
    if (slices_.size() == 1) {
      if (!only_one_) return bad("a single slice is no volume");
      out_.slices.push_back(slices_[0].ref);
      return {};
    }
    std::vector<double> steps;
    for (std::size_t i = 1; i < slices_.size(); ++i)
      steps.push_back(slices_[i].along_mm - slices_[i - 1].along_mm);
    std::vector<double> sorted = steps;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2),
                     sorted.end());
    const double usual = sorted[sorted.size() / 2];
    std::vector<std::string> gaps;
    std::size_t missing = 0, widest = 0;
    out_.slices.push_back(slices_[0].ref);
    for (std::size_t i = 1; i < slices_.size(); ++i) {
      const double ratio = steps[i - 1] / usual;
      const double whole = std::round(ratio);
      if (whole < 1.0 || whole > 2000.0 || std::abs(ratio - whole) > kUneven * whole)
        return bad(fmt::format("uneven slices: {:.3g} mm between {} and {}, {:.3g} mm elsewhere",
                               steps[i - 1], slices_[i - 1].name(), slices_[i].name(), usual));
      const auto between = static_cast<std::size_t>(whole) - 1;
      if (between > 0) {
        gaps.push_back(
            fmt::format("{} between {} and {}", between, slices_[i - 1].name(), slices_[i].name()));
        missing += between;
        widest = std::max(widest, between);
        out_.slices.resize(out_.slices.size() + between);
      }
      out_.slices.push_back(slices_[i].ref);
    }
    if (widest > 1 || missing > std::max<std::size_t>(1, slices_.size() / 50))
      return bad(fmt::format("{} slices are missing: {}", missing, some_of(gaps)));
    if (missing > 0)
      out_.warnings.push_back(fmt::format("missing slices, filled from their neighbours: {}", some_of(gaps)));
    out_.grid.size[2] = static_cast<int>(out_.slices.size());
    return {};
  }

  /// Positions must lie on one line, which may lean (gantry tilt).
  Status check_line() {
    if (slices_.size() < 2) return {};
    const Vector3 from = slices_.front().plane->position_mm, to = slices_.back().plane->position_mm;
    const Vector3 step = (to - from) / static_cast<double>(out_.slices.size() - 1);
    out_.grid.step_mm.col(2) = step;
    std::size_t at = 0;
    for (std::size_t k = 0; k < out_.slices.size(); ++k) {
      if (!out_.slices[k]) continue;
      const Slice& s = slices_[at++];
      const Vector3 off = s.plane->position_mm - (from + static_cast<double>(k) * step);
      if (off.norm() > std::max(0.05, 0.3 * step.norm()))
        return bad(
            fmt::format("slices out of line: {} lies {:.3g} mm beside the others", s.name(), off.norm()));
    }
    return {};
  }

  void tell_tilt() {
    if (slices_.size() < 2) return;
    const Vector3 step = out_.grid.step_mm.col(2).normalized();
    out_.tilt_deg = std::atan2(normal_.cross(step).norm(), normal_.dot(step)) * 180.0 / std::numbers::pi;
    const double told = std::abs(slices_[0].file->tilt_deg);
    if (out_.tilt_deg > 0.05)
      out_.warnings.push_back(
          fmt::format("gantry tilt {:.1f} degrees: the grid is sheared, and read so", out_.tilt_deg));
    else if (told > 0.5)
      out_.warnings.push_back(fmt::format(
          "its header tells of {:.1f} degrees of gantry tilt, the slices' positions of none: a volume that "
          "was not resampled is sheared",
          told));
  }

  const std::vector<DicomHeader>& files_;
  const std::string& name_;
  bool only_one_;
  std::vector<Slice> slices_;
  Vector3 normal_ = Vector3::UnitZ();
  SliceStack out_;
};

}  // namespace

Result<SliceStack> stack_slices(const std::vector<DicomHeader>& files, const std::string& name,
                                bool only_one) {
  return Stacker(files, name, only_one).stack();
}

}  // namespace gnathion
