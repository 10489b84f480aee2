#include "anatomy/volume/read_volume.h"

#include <algorithm>
#include <fstream>

#include "anatomy/volume/dicom_file.h"
#include "anatomy/volume/dicom_volume.h"
#include "anatomy/volume/volume_checks.h"
#include "core/file.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;

enum class Format { kNone, kDicom, kNifti, kNrrd, kNrrdHeader };

bool ends_with(const std::string& name, const char* end) {
  const std::string_view e(end);
  return name.size() >= e.size() && name.compare(name.size() - e.size(), e.size(), e) == 0;
}

Format format_of(const fs::path& file) {
  std::string name = file.filename().string();
  for (char& c : name) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  if (ends_with(name, ".nii") || ends_with(name, ".nii.gz")) return Format::kNifti;
  if (ends_with(name, ".nrrd")) return Format::kNrrd;
  if (ends_with(name, ".nhdr")) return Format::kNrrdHeader;
  std::ifstream in(file, std::ios::binary);
  std::string first(352, '\0');
  in.read(first.data(), static_cast<std::streamsize>(first.size()));
  first.resize(static_cast<std::size_t>(in.gcount()));
  if (first.compare(0, 4, "NRRD") == 0) return Format::kNrrd;
  if (first.size() >= 348 && first.compare(344, 3, "n+1") == 0) return Format::kNifti;
  return dicom_kind(first, file.filename().string()) == DicomKind::kNot ? Format::kNone : Format::kDicom;
}

/// The one NIfTI or NRRD file of a folder; an empty path where there is none, an error where there are
/// several.
Result<fs::path> volume_file_in(const fs::path& folder) {
  std::vector<fs::path> found;
  std::error_code ec;
  for (fs::directory_iterator it(folder, ec), end; !ec && it != end; it.increment(ec)) {
    if (!it->is_regular_file(ec)) continue;
    const Format format = format_of(it->path());
    if (format == Format::kNifti || format == Format::kNrrd || format == Format::kNrrdHeader)
      found.push_back(it->path());
  }
  std::sort(found.begin(), found.end());
  if (found.size() > 1)
    return bad_input(
        kReadVolume, folder.string(),
        "several volumes, name one: " + found[0].filename().string() + ", " + found[1].filename().string());
  return found.empty() ? fs::path() : found[0];
}

Result<VolumeFile> read_one(const fs::path& file, Format format, const ReadVolumeOptions& options) {
  GNATHION_TRY(const std::string bytes, read_file(file));
  return format == Format::kNifti ? parse_nifti(bytes, file.string(), options)
                                  : parse_nrrd(bytes, file.string(), options);
}

/// What the path means: a file of one format, or a DICOM folder.
struct Target {
  fs::path path;
  Format format = Format::kDicom;
};
Result<Target> target_of(const fs::path& path) {
  std::error_code ec;
  if (!fs::exists(path, ec)) return bad_input(kReadVolume, path.string(), "there is no such file or folder");
  Target target{path, Format::kDicom};
  if (fs::is_directory(path, ec)) {
    GNATHION_TRY(const fs::path file, volume_file_in(path));
    if (file.empty()) return target;
    target.path = file;
  }
  target.format = format_of(target.path);
  if (target.format == Format::kNone)
    return bad_input(kReadVolume, target.path.string(), "neither DICOM nor NIfTI nor NRRD");
  return target;
}

}  // namespace

Result<VolumeFile> read_volume(const fs::path& path, const ReadVolumeOptions& options, Progress& progress) {
  try {
    GNATHION_TRY(const Target target, target_of(path));
    if (target.format == Format::kDicom) return read_dicom(target.path, options, progress);
    return read_one(target.path, target.format, options);
  } catch (const std::bad_alloc&) {
    return bad_input(kReadVolume, path.string(), "not enough memory for it");
  } catch (const fs::filesystem_error& e) {
    return bad_input(kReadVolume, path.string(), e.what());
  }
}

Result<std::vector<VolumeInfo>> list_volumes(const fs::path& path) {
  GNATHION_TRY(const Target target, target_of(path));
  if (target.format == Format::kDicom) return list_dicom(target.path);
  GNATHION_TRY(VolumeFile file, read_one(target.path, target.format, {}));
  return std::vector<VolumeInfo>{std::move(file.info)};
}

bool may_hold_volume(const fs::path& path) {
  std::error_code ec;
  if (!fs::is_directory(path, ec)) return fs::exists(path, ec) && format_of(path) != Format::kNone;
  std::size_t looked = 0;
  for (fs::recursive_directory_iterator it(path, fs::directory_options::skip_permission_denied, ec), end;
       !ec && it != end; it.increment(ec)) {
    if (!it->is_regular_file(ec)) continue;
    if (format_of(it->path()) != Format::kNone) return true;
    if (++looked > 2000) return false;
  }
  return false;
}

}  // namespace gnathion
