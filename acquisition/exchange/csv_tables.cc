#include "acquisition/exchange/csv_tables.h"

#include <fmt/format.h>

#include <cctype>
#include <cerrno>
#include <cstring>

#include "acquisition/exchange/plus_sequence.h"

namespace gnathion {
namespace {

constexpr const char* kTimes = "sequence,capture_s,capture_ns,arrival_ns,device_ns";

std::string hex(const std::string& bytes) {
  std::string out;
  for (const char c : bytes) out += fmt::format("{:02x}", static_cast<unsigned char>(c));
  return out;
}

/// Quaternions with qw ≥ 0; numbers in the fewest digits that give the same double again.
std::string pose_row(const PoseSample& p) {
  Eigen::Quaterniond q(p.reference_from_body.rotation);
  if (q.w() < 0) q.coeffs() *= -1;
  const Vector3& t = p.reference_from_body.translation_mm;
  return fmt::format("{},{},{},{},{},{},{},{},{},{},{}", p.valid ? 1 : 0, csv_text(p.reason),
                     csv_text(p.reference), csv_text(p.body), t.x(), t.y(), t.z(), q.w(), q.x(), q.y(),
                     q.z());
}

const char* fate_name(LedgerSample::Fate fate) {
  return fate == LedgerSample::Fate::kMissing    ? "missing"
         : fate == LedgerSample::Fate::kRejected ? "rejected"
                                                 : "accepted";
}

}  // namespace

std::string file_stem(const std::string& stream) {
  std::string stem;
  for (const char c : stream) {
    const bool plain = std::isalnum(static_cast<unsigned char>(c)) || c == '_' || c == '-';
    if (plain)
      stem += c;
    else if (c == '/' && !stem.empty())
      stem += '.';
    else
      stem += fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return stem == "ledger" ? "%6Cedger" : stem;  // that table is another
}

std::string csv_text(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string out = "\"";
  for (const char c : text) out += c == '"' ? std::string("\"\"") : std::string(1, c);
  return out + "\"";
}

Status CsvTables::row(const std::string& file, const std::string& columns, const std::string& text) {
  auto& table = tables_[file];
  if (!table) {
    table = std::make_unique<std::ofstream>(folder_ / file, std::ios::binary);
    *table << columns << "\n";
  }
  *table << text << "\n";
  if (*table) return {};
  return fail(ErrorCode::kInternal, "cannot write table", (folder_ / file).string(), std::strerror(errno));
}

Status CsvTables::write(const Sample& sample) {
  const SampleHeader& h = header_of(sample);
  if (!start_) start_ = h.capture;
  const std::string times =
      fmt::format("{},{},{},{},{}", h.sequence, decimal_seconds(h.capture.ns - start_->ns), h.capture.ns,
                  h.arrival.ns, h.device.ns);
  const std::string file = file_stem(h.stream) + ".csv";
  const auto with_times = [&](const std::string& columns, const std::string& text) {
    return row(file, fmt::format("{},{}", kTimes, columns), times + "," + text);
  };
  if (const auto* pose = std::get_if<PoseSample>(&sample))
    return with_times("valid,reason,reference,body,x_mm,y_mm,z_mm,qw,qx,qy,qz", pose_row(*pose));
  if (const auto* event = std::get_if<EventSample>(&sample))
    return with_times("kind,pressed,text", fmt::format("{},{},{}", csv_text(event->kind),
                                                       event->pressed ? 1 : 0, csv_text(event->text)));
  if (const auto* line = std::get_if<LedgerSample>(&sample))
    return row("ledger.csv", fmt::format("stream,fate,count,reason,{}", kTimes),
               fmt::format("{},{},{},{},{}", csv_text(h.stream), fate_name(line->fate), line->count,
                           csv_text(line->reason), times));
  if (const auto* scan = std::get_if<ScanSample>(&sample))
    return with_times("name,sha256,deviation_mm",
                      fmt::format("{},{},{}", csv_text(scan->name), scan->sha256, scan->deviation_mm));
  if (const auto* transfer = std::get_if<TransferSample>(&sample))
    return with_times("endpoint,status,data_hex",
                      fmt::format("{},{},{}", transfer->endpoint, transfer->status, hex(transfer->data)));
  if (const auto* frame = std::get_if<FrameSample>(&sample))
    return with_times("width_px,height_px",
                      fmt::format("{},{}", frame->image.width_px, frame->image.height_px));
  return {};
}

Status CsvTables::write_frame(const FrameSample& frame, const std::string& file) {
  const SampleHeader& h = frame.header;
  return row(file_stem(h.stream) + "/timestamps.csv", "file,sequence,capture_ns,arrival_ns,device_ns",
             fmt::format("{},{},{},{},{}", file, h.sequence, h.capture.ns, h.arrival.ns, h.device.ns));
}

Result<std::vector<std::string>> CsvTables::finish() {
  std::vector<std::string> files;
  for (auto& [file, table] : tables_) {
    table->close();
    if (!*table)
      return fail(ErrorCode::kInternal, "cannot write table", (folder_ / file).string(),
                  std::strerror(errno));
    files.push_back(file);
  }
  tables_.clear();
  return files;
}

}  // namespace gnathion
