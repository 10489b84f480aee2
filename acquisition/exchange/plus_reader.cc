// The pixels of a PLUS sequence, frame by frame.
#include <fmt/format.h>
#include <zlib.h>

#include <algorithm>
#include <fstream>
#include <limits>
#include <sstream>

#include "acquisition/exchange/plus_sequence.h"

namespace gnathion {
namespace {

namespace fs = std::filesystem;
constexpr const char* kWhat = "cannot read sequence";
constexpr std::size_t kBlock = 64 << 10;
constexpr std::size_t kLargestHeader = std::size_t{1} << 30;

std::size_t bytes_of(PlusPixel pixel) {
  switch (pixel) {
    case PlusPixel::kUint8:
    case PlusPixel::kInt8:
      return 1;
    case PlusPixel::kUint16:
    case PlusPixel::kInt16:
      return 2;
    case PlusPixel::kUint32:
    case PlusPixel::kInt32:
    case PlusPixel::kFloat:
      return 4;
    case PlusPixel::kDouble:
      return 8;
    case PlusPixel::kOther:
      break;
  }
  return 0;
}

/// The text up to the line that ends it, however much data follows.
std::string read_header_text(std::istream& in) {
  std::string text, block(kBlock, '\0');
  while (text.size() < kLargestHeader) {
    in.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto n = static_cast<std::size_t>(in.gcount());
    const std::size_t before = text.size();
    text.append(block, 0, n);
    const std::size_t from = before < 32 ? 0 : before - 32;
    const bool nrrd = text.compare(0, 4, "NRRD") == 0;
    const std::size_t last = nrrd ? std::min(text.find("\n\n", from), text.find("\n\r\n", from))
                                  : text.find("\nElementDataFile", from);
    const bool hopeless =
        before == 0 && !nrrd && text.substr(0, text.find('\n')).find('=') == std::string::npos;
    if (n == 0 || hopeless) break;
    if (last == std::string::npos || text.find('\n', last + 1) == std::string::npos) {
      // The line itself may go on in the next block: look for it again from its start.
      if (last != std::string::npos && !nrrd) {
        std::string rest;
        std::getline(in, rest);
        text += rest + "\n";
        break;
      }
      continue;
    }
    break;
  }
  return text;
}

}  // namespace

struct PlusReader::State {
  std::string name;
  PlusHeader header;
  std::unique_ptr<std::istream> data;
  std::size_t frame_bytes = 0, next_frame = 0;
  z_stream zip{};
  bool zip_ready = false;
  std::string zipped = std::string(kBlock, '\0');

  ~State() {
    if (zip_ready) ::inflateEnd(&zip);
  }
  tl::unexpected<Error> refuse(std::string why) const { return bad_input(kWhat, name, std::move(why)); }
  Result<std::string> read_plain();
  Result<std::string> read_zipped();
};

PlusReader::PlusReader(std::unique_ptr<State> state) : state_(std::move(state)) {}
PlusReader::PlusReader(PlusReader&&) noexcept = default;
PlusReader::~PlusReader() = default;
const PlusSequence& PlusReader::sequence() const {
  return state_->header.sequence;
}

Result<PlusReader> PlusReader::open(const fs::path& path) {
  auto file = std::make_unique<std::ifstream>(path, std::ios::binary);
  if (!*file || fs::is_directory(path)) return bad_input(kWhat, path.string(), "cannot be opened");
  auto state = std::make_unique<State>();
  state->name = path.string();
  const std::string text = read_header_text(*file);
  GNATHION_TRY(state->header, parse_plus_header(text, path.string()));
  file->clear();
  const PlusData& data = state->header.data;
  if (data.file.empty()) {
    state->data = std::move(file);
  } else if (state->header.sequence.width_px > 0) {
    const fs::path beside(data.file);
    if (beside.has_parent_path() || data.file == "LIST")
      return state->refuse(fmt::format("its data file '{}' is not a file beside it", data.file));
    state->data = std::make_unique<std::ifstream>(path.parent_path() / beside, std::ios::binary);
    if (!*state->data)
      return state->refuse(
          fmt::format("its data file {} is not there; it belongs beside the header", data.file));
  }
  return with_data(std::move(state));
}

Result<PlusReader> PlusReader::parse(std::string bytes, const std::string& name) {
  auto state = std::make_unique<State>();
  state->name = name;
  GNATHION_TRY(state->header, parse_plus_header(bytes, name));
  if (!state->header.data.file.empty()) return state->refuse("keeps its data in another file");
  state->data = std::make_unique<std::istringstream>(std::move(bytes));
  return with_data(std::move(state));
}

/// Positions the data's stream and checks what can be checked before reading.
Result<PlusReader> PlusReader::with_data(std::unique_ptr<State> state) {
  const PlusSequence& s = state->header.sequence;
  if (s.width_px == 0) return PlusReader(std::move(state));
  state->frame_bytes = static_cast<std::size_t>(s.width_px) * static_cast<std::size_t>(s.height_px) *
                       static_cast<std::size_t>(s.channels) * bytes_of(s.pixel);
  std::istream& data = *state->data;
  const std::uint64_t offset = state->header.data.file.empty() ? state->header.data.offset : 0;
  data.seekg(0, std::ios::end);
  const auto size = static_cast<std::uint64_t>(std::max<std::streamoff>(0, data.tellg()));
  data.seekg(static_cast<std::streamoff>(offset));
  const bool plain = !state->header.data.compressed;
  if (plain && state->frame_bytes > 0 &&
      (size - std::min(size, offset)) / state->frame_bytes < s.frames.size())
    return state->refuse(fmt::format("truncated: {} images of {} bytes announced, {} bytes present",
                                     s.frames.size(), state->frame_bytes, size - std::min(size, offset)));
  if (!plain) {
    constexpr int kEither = 15 + 32;  // zlib or gzip
    state->zip_ready = ::inflateInit2(&state->zip, kEither) == Z_OK;
    if (!state->zip_ready) return fail(ErrorCode::kInternal, kWhat, state->name, "zlib does not start");
  }
  return PlusReader(std::move(state));
}

Result<std::string> PlusReader::State::read_plain() {
  std::string pixels(frame_bytes, '\0');
  data->read(pixels.data(), static_cast<std::streamsize>(frame_bytes));
  if (static_cast<std::size_t>(data->gcount()) != frame_bytes)
    return refuse(fmt::format("truncated in image {}", next_frame));
  return pixels;
}

/// Grows with what comes out, not with what the header announced.
Result<std::string> PlusReader::State::read_zipped() {
  std::string pixels;
  while (pixels.size() < frame_bytes) {
    if (zip.avail_in == 0) {
      data->read(zipped.data(), static_cast<std::streamsize>(zipped.size()));
      zip.next_in = reinterpret_cast<Bytef*>(zipped.data());
      zip.avail_in = static_cast<uInt>(data->gcount());
      if (zip.avail_in == 0) return refuse(fmt::format("truncated in image {}", next_frame));
    }
    const std::size_t before = pixels.size(), room = std::min(frame_bytes - before, std::size_t{1} << 20);
    pixels.resize(before + room);
    zip.next_out = reinterpret_cast<Bytef*>(pixels.data() + before);
    zip.avail_out = static_cast<uInt>(room);
    const int status = ::inflate(&zip, Z_NO_FLUSH);
    pixels.resize(before + room - zip.avail_out);
    if (status == Z_STREAM_END && pixels.size() < frame_bytes)
      return refuse(fmt::format("its data ends in image {}", next_frame));
    if (status != Z_OK && status != Z_STREAM_END && status != Z_BUF_ERROR)
      return refuse(fmt::format("its compressed data is damaged in image {}", next_frame));
  }
  return pixels;
}

Result<std::string> PlusReader::next_pixels() {
  State& s = *state_;
  const PlusSequence& sequence = s.header.sequence;
  if (sequence.width_px == 0 || s.frame_bytes == 0) return s.refuse("has no pixels that can be read");
  if (s.next_frame >= sequence.frames.size()) return s.refuse("has no further image");
  GNATHION_TRY(std::string pixels, s.header.data.compressed ? s.read_zipped() : s.read_plain());
  ++s.next_frame;
  const std::size_t each = bytes_of(sequence.pixel);
  if (s.header.data.big_endian && each > 1)
    for (std::size_t at = 0; at + each <= pixels.size(); at += each)
      std::reverse(pixels.begin() + static_cast<std::ptrdiff_t>(at),
                   pixels.begin() + static_cast<std::ptrdiff_t>(at + each));
  return pixels;
}

}  // namespace gnathion
