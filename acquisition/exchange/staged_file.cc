#include "acquisition/exchange/staged_file.h"

#include <fmt/format.h>
#include <unistd.h>

namespace gnathion {

Status write_whole_recording(const std::filesystem::path& out,
                             const std::function<Status(RecordingWriter&)>& fill) {
  namespace fs = std::filesystem;
  const fs::path part = out.parent_path() / fmt::format(".{}.part.{}", out.filename().string(), ::getpid());
  const auto all = [&]() -> Status {
    GNATHION_TRY(RecordingWriter writer, RecordingWriter::create(part));
    GNATHION_CHECK_OK(fill(writer));
    return writer.finish();
  };
  Status status = all();
  std::error_code ec;
  if (status) {
    fs::rename(part, out, ec);
    if (ec) status = fail(ErrorCode::kInternal, "cannot write recording", out.string(), ec.message());
  }
  if (!status) fs::remove(part, ec);
  return status;
}

}  // namespace gnathion
