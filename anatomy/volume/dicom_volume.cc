#include "anatomy/volume/dicom_volume.h"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <map>

#include "anatomy/volume/dicom_series.h"
#include "anatomy/volume/volume_checks.h"
#include "core/file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMostFiles = 20000;

/// One series: its files' headers and where they are.
struct Series {
  std::vector<DicomHeader> headers;
  std::string uid() const { return headers[0].series_uid; }
  /// "#1 'mandible' (CT, 400 files, 1.2.3)"
  std::string told(std::size_t place) const {
    const DicomHeader& h = headers[0];
    return fmt::format("#{} '{}' ({}, {} files, {})", place + 1, h.description, h.modality, headers.size(),
                       h.series_uid);
  }
};

struct Folder {
  std::vector<Series> series;  ///< by number, then UID
  std::vector<std::string> warnings;
};

std::string first_bytes(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string bytes(132, '\0');
  in.read(bytes.data(), 132);
  bytes.resize(static_cast<std::size_t>(in.gcount()));
  return bytes;
}

Result<std::vector<fs::path>> files_of(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code ec;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, ec);
  for (; !ec && it != fs::recursive_directory_iterator(); it.increment(ec)) {
    if (!it->is_regular_file(ec)) continue;
    files.push_back(it->path());
    if (files.size() > kMostFiles)
      return bad_input(kReadVolume, folder.string(),
                       fmt::format("more than {} files: name the series' own folder", kMostFiles));
  }
  if (ec) return bad_input(kReadVolume, folder.string(), ec.message());
  std::sort(files.begin(), files.end());
  return files;
}

Result<DicomHeader> header_of_file(const fs::path& path) {
  GNATHION_TRY(const std::string bytes, read_file(path));
  GNATHION_CHECK_OK(check_dicom_structure(bytes, path.string()));
  return parse_dicom_header(bytes, path.string());
}

/// Every series below the folder. Files that cannot be read are named, not skipped in silence.
Result<Folder> scan(const fs::path& folder) {
  GNATHION_TRY(const std::vector<fs::path> files, files_of(folder));
  Folder out;
  std::map<std::string, Series> by_uid;
  std::size_t others = 0;
  std::vector<std::pair<std::string, std::string>> broken;  // file, why
  for (const fs::path& file : files) {
    switch (dicom_kind(first_bytes(file), file.filename().string())) {
      case DicomKind::kNot:
        ++others;
        continue;
      case DicomKind::kDirectory:
        continue;
      case DicomKind::kEncrypted:
        return bad_input(kReadVolume, file.string(), "encrypted: export it without protection");
      case DicomKind::kDicom:
        break;
    }
    auto header = header_of_file(file);
    if (!header)
      broken.emplace_back(file.filename().string(), header.error().why);
    else
      by_uid[header->series_uid].headers.push_back(std::move(*header));
  }
  if (by_uid.empty() && !broken.empty())
    return bad_input(kReadVolume, folder.string(), fmt::format("{} ({})", broken[0].first, broken[0].second));
  if (by_uid.empty()) return bad_input(kReadVolume, folder.string(), "no DICOM files in it");
  for (auto& [uid, series] : by_uid) out.series.push_back(std::move(series));
  std::stable_sort(out.series.begin(), out.series.end(), [](const Series& a, const Series& b) {
    const auto number = [](const Series& s) { return std::atol(s.headers[0].series_number.c_str()); };
    return number(a) < number(b);
  });
  for (std::size_t i = 0; i < std::min<std::size_t>(3, broken.size()); ++i)
    out.warnings.push_back(fmt::format("left out, unreadable: {} ({})",
                                       out.series[0].headers[0].without_identity(broken[i].first),
                                       broken[i].second));
  if (broken.size() > 3)
    out.warnings.push_back(fmt::format("left out, unreadable: {} more files", broken.size() - 3));
  if (others > 0) out.warnings.push_back(fmt::format("{} files in the folder are not DICOM", others));
  return out;
}

/// Copies one picture's values to slice k.
void put_slice(const DicomPixels& pixels, std::size_t plane, const DicomPlane& scale, bool as_float,
               std::size_t k, Volume& volume) {
  const std::size_t n =
      static_cast<std::size_t>(volume.grid.size[0]) * static_cast<std::size_t>(volume.grid.size[1]);
  const std::int16_t* from = pixels.values.data() + plane * n;
  if (!as_float) {
    std::copy(from, from + n, volume.voxels16.begin() + static_cast<std::ptrdiff_t>(k * n));
    return;
  }
  for (std::size_t i = 0; i < n; ++i)
    volume.voxels[k * n + i] = static_cast<float>(scale.slope * (from[i] + pixels.offset) + scale.intercept);
}

bool same_pixels(const DicomPixels& a, std::size_t plane_a, const DicomPixels& b, std::size_t plane_b,
                 std::size_t n) {
  return a.offset == b.offset && std::equal(a.values.begin() + static_cast<std::ptrdiff_t>(plane_a * n),
                                            a.values.begin() + static_cast<std::ptrdiff_t>((plane_a + 1) * n),
                                            b.values.begin() + static_cast<std::ptrdiff_t>(plane_b * n));
}

/// Between two neighbours where a slice is missing (they are never two in a row).
void fill_gaps(const std::vector<std::optional<SliceRef>>& slices, Volume& volume) {
  const std::size_t n =
      static_cast<std::size_t>(volume.grid.size[0]) * static_cast<std::size_t>(volume.grid.size[1]);
  for (std::size_t k = 1; k + 1 < slices.size(); ++k) {
    if (slices[k]) continue;
    for (std::size_t i = 0; i < n; ++i) {
      const std::size_t at = k * n + i;
      if (!volume.voxels16.empty())
        volume.voxels16[at] =
            static_cast<std::int16_t>((volume.voxels16[at - n] + volume.voxels16[at + n]) / 2);
      else
        volume.voxels[at] = 0.5f * (volume.voxels[at - n] + volume.voxels[at + n]);
    }
  }
}

void describe(const std::vector<DicomHeader>& headers, const SliceStack& stack, VolumeInfo& info) {
  const DicomHeader& h = headers[0];
  info.format = "DICOM";
  info.series_uid = h.series_uid;
  info.series_number = h.series_number;
  info.description = h.description;
  info.modality = h.modality;
  info.transfer_syntax = transfer_syntax_name(h.transfer_syntax);
  info.patient_name = h.patient_name;
  info.patient_id = h.patient_id;
  info.patient_birth_date = h.patient_birth_date;
  info.date = h.date;
  info.files = headers.size();
  info.grid = stack.grid;
  info.gantry_tilt_deg = stack.tilt_deg;
  info.warnings = stack.warnings;
  if (h.modality != "CT" && !h.modality.empty())
    info.warnings.push_back("modality " + h.modality + ": its values are not radiodensity");
  if (h.lossy) info.warnings.push_back("its pixels were compressed with loss");
  if (h.encrypted_attributes)
    info.warnings.push_back("identity is encrypted in the file; the pictures are not");
}

bool one_scale(const std::vector<DicomHeader>& headers, const SliceStack& stack) {
  const auto plane = [&](const SliceRef& r) -> const DicomPlane& { return headers[r.file].planes[r.plane]; };
  const DicomPlane& first = plane(*stack.slices[0]);
  const DicomHeader& one = headers[stack.slices[0]->file];
  return std::all_of(stack.slices.begin(), stack.slices.end(), [&](const auto& s) {
    return !s ||
           (plane(*s).slope == first.slope && plane(*s).intercept == first.intercept &&
            headers[s->file].is_signed == one.is_signed && headers[s->file].bits_stored == one.bits_stored);
  });
}

/// Reads files one after the other and puts their pictures where they belong.
template <class ReadBytes>
Result<VolumeFile> assemble(const std::vector<DicomHeader>& headers, const SliceStack& stack,
                            const std::string& name, const ReadVolumeOptions& options,
                            const ReadBytes& bytes_of_file, Progress& progress) {
  VolumeFile out;
  describe(headers, stack, out.info);
  const bool as_float = !one_scale(headers, stack);
  GNATHION_CHECK_OK(check_grid(stack.grid, as_float ? 4 : 2, options.largest_bytes, name, out.info.warnings));
  Volume& volume = out.volume;
  volume.grid = stack.grid;
  if (as_float)
    volume.voxels.resize(stack.grid.count());
  else
    volume.voxels16.resize(stack.grid.count());

  std::vector<std::vector<std::pair<std::size_t, std::size_t>>> wanted(
      headers.size());  // by file: (plane, k)
  for (std::size_t k = 0; k < stack.slices.size(); ++k)
    if (stack.slices[k]) wanted[stack.slices[k]->file].push_back({stack.slices[k]->plane, k});
  const std::size_t n =
      static_cast<std::size_t>(stack.grid.size[0]) * static_cast<std::size_t>(stack.grid.size[1]);
  int offset = 0;
  for (std::size_t f = 0; f < headers.size(); ++f) {
    if (wanted[f].empty()) continue;
    GNATHION_TRY(const std::string bytes, bytes_of_file(f));
    GNATHION_TRY(const DicomPixels pixels, decode_dicom_pixels(bytes, headers[f]));
    offset = pixels.offset;
    for (const auto& [plane, k] : wanted[f])
      put_slice(pixels, plane, headers[f].planes[plane], as_float, k, volume);
    progress.update(static_cast<double>(f + 1) / static_cast<double>(headers.size()));
  }
  for (const SliceStack::Twin& twin : stack.twins) {
    const DicomHeader &a = headers[twin.kept.file], &b = headers[twin.other.file];
    GNATHION_TRY(const std::string bytes_a, bytes_of_file(twin.kept.file));
    GNATHION_TRY(const std::string bytes_b, bytes_of_file(twin.other.file));
    GNATHION_TRY(const DicomPixels pixels_a, decode_dicom_pixels(bytes_a, a));
    GNATHION_TRY(const DicomPixels pixels_b, decode_dicom_pixels(bytes_b, b));
    const std::string names = a.shown_name() + " and " + b.shown_name();
    if (!same_pixels(pixels_a, twin.kept.plane, pixels_b, twin.other.plane, n))
      return bad_input(kReadVolume, name,
                       "two different slices at one place: " + names +
                           (a.acquisition != b.acquisition ? " (two acquisitions in one series)" : ""));
    out.info.warnings.push_back("the same slice twice, one left out: " + names);
  }
  if (!as_float) {
    const DicomPlane& scale = headers[stack.slices[0]->file].planes[stack.slices[0]->plane];
    volume.slope = scale.slope;
    volume.intercept = scale.intercept + scale.slope * offset;
  }
  fill_gaps(stack.slices, volume);
  return out;
}

/// The series that is asked for.
Result<std::size_t> choose(const Folder& folder, const std::string& asked, const std::string& name) {
  if (asked.empty()) {
    if (folder.series.size() == 1) return 0;
    std::vector<std::size_t> usable;
    std::string list;
    for (std::size_t s = 0; s < folder.series.size(); ++s) {
      if (!stack_slices(folder.series[s].headers, name)) continue;
      usable.push_back(s);
      list += (list.empty() ? "" : "; ") + folder.series[s].told(s);
    }
    if (usable.size() == 1) return usable[0];
    if (usable.empty()) return 0;  // and say why not
    return bad_input(kReadVolume, name, "several series, choose one with --series: " + list);
  }
  std::vector<std::size_t> found;
  for (std::size_t s = 0; s < folder.series.size(); ++s) {
    const DicomHeader& h = folder.series[s].headers[0];
    if (asked == h.series_uid || asked == h.series_number || asked == fmt::format("#{}", s + 1))
      found.push_back(s);
  }
  if (found.size() == 1) return found[0];
  std::string list;
  for (std::size_t s = 0; s < folder.series.size(); ++s) list += (s ? "; " : "") + folder.series[s].told(s);
  return bad_input(kReadVolume, name,
                   fmt::format("{} series are '{}': {}", found.empty() ? "no" : "several", asked, list));
}

}  // namespace

Result<VolumeFile> read_dicom(const fs::path& path, const ReadVolumeOptions& options, Progress& progress) {
  std::error_code ec;
  ReadVolumeOptions chosen = options;
  fs::path folder = path;
  if (!fs::is_directory(path, ec)) {
    GNATHION_TRY(const DicomHeader header, header_of_file(path));
    if (header.planes.size() > 1 || header.series_uid.empty()) {
      GNATHION_TRY(const std::string bytes, read_file(path));
      return parse_dicom(bytes, path.string(), options);
    }
    folder = path.has_parent_path() ? path.parent_path() : fs::path(".");  // one slice stands for its series
    if (chosen.series.empty()) chosen.series = header.series_uid;
  }
  GNATHION_TRY(const Folder found, scan(folder));
  GNATHION_TRY(const std::size_t which, choose(found, chosen.series, folder.string()));
  const Series& series = found.series[which];
  GNATHION_TRY(const SliceStack stack, stack_slices(series.headers, folder.string()));
  GNATHION_TRY(VolumeFile out,
               assemble(
                   series.headers, stack, folder.string(), options,
                   [&](std::size_t f) { return read_file(series.headers[f].name); }, progress));
  out.info.warnings.insert(out.info.warnings.end(), found.warnings.begin(), found.warnings.end());
  if (options.series.empty() && found.series.size() > 1)
    out.info.warnings.push_back(
        fmt::format("{} other series in the folder hold no volume", found.series.size() - 1));
  return out;
}

Result<std::vector<VolumeInfo>> list_dicom(const fs::path& path) {
  std::error_code ec;
  Folder found;
  if (fs::is_directory(path, ec)) {
    GNATHION_TRY(found, scan(path));
  } else {
    GNATHION_TRY(DicomHeader header, header_of_file(path));
    found.series.push_back({{std::move(header)}});
  }
  std::vector<VolumeInfo> out;
  for (const Series& series : found.series) {
    VolumeInfo info;
    const auto stack = stack_slices(series.headers, path.string(), !fs::is_directory(path, ec));
    describe(series.headers, stack ? *stack : SliceStack{}, info);
    if (!stack) {
      info.grid.size = {series.headers[0].columns, series.headers[0].rows, 0};
      info.warnings.push_back("no volume: " + stack.error().why);
    } else if (const auto fits = check_grid(stack->grid, 2, ReadVolumeOptions{}.largest_bytes, path.string(),
                                            info.warnings);
               !fits) {
      info.warnings.push_back("no volume: " + fits.error().why);
    }
    info.warnings.insert(info.warnings.end(), found.warnings.begin(), found.warnings.end());
    out.push_back(std::move(info));
  }
  return out;
}

Result<VolumeFile> parse_dicom(const std::string& bytes, const std::string& name,
                               const ReadVolumeOptions& options) {
  if (dicom_kind(bytes, name) == DicomKind::kEncrypted)
    return bad_input(kReadVolume, name, "encrypted: export it without protection");
  GNATHION_CHECK_OK(check_dicom_structure(bytes, name));
  GNATHION_TRY(DicomHeader header, parse_dicom_header(bytes, name));
  const std::vector<DicomHeader> headers{std::move(header)};
  GNATHION_TRY(const SliceStack stack, stack_slices(headers, name, true));
  SilentProgress silent;
  return assemble(
      headers, stack, name, options, [&](std::size_t) -> Result<std::string> { return bytes; }, silent);
}

}  // namespace gnathion
