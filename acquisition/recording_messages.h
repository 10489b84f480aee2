// Samples to the messages of a recording and back. Pure: no files.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/sample.h"

namespace google::protobuf {
class Descriptor;
}

namespace gnathion {

/// The schemas of a recording's messages.
enum class MessageType : std::uint8_t { kImage, kEvent, kLedger, kTransform, kPoseState, kScan, kTransfer };
const google::protobuf::Descriptor& descriptor_of(MessageType type);
/// Nothing for schemas of other programs.
std::optional<MessageType> message_type_of(const std::string& schema_name);

/// Unchanged where it is UTF-8, as texts of protobuf and MCAP must be; U+FFFD for each byte that is not.
std::string valid_utf8(const std::string& text);

/// A message in two parts, so that an image's pixels are copied only once: into the chunk.
struct EncodedMessage {
  std::string head;
  std::string_view body;  ///< into the sample; may be empty
};
EncodedMessage encode_image(const FrameSample& frame);
std::string encode_event(const EventSample& event);
/// `from_source`: the line is a sample by itself, not the one that stands before an accepted frame.
std::string encode_ledger(const LedgerSample& line, bool from_source);
std::string encode_transform(const PoseSample& pose);
std::string encode_pose_state(const PoseSample& pose);
/// `attachments`: the name under which each of scan_file_order(scan) is attached.
std::string encode_scan(const ScanSample& scan, const std::vector<std::string>& attachments);
std::string encode_transfer(const TransferSample& transfer);

/// The files of a scan, its mesh first.
std::vector<std::string> scan_file_order(const ScanSample& scan);

// `header` comes from the message's envelope, without the device time. Refused are bytes that do not parse
// and values that no sample has; `where` is for the error's line.
Result<FrameSample> decode_image(SampleHeader header, std::string_view bytes, const std::string& where);
Result<EventSample> decode_event(SampleHeader header, std::string_view bytes, const std::string& where);
struct LedgerMessage {
  LedgerSample line;
  bool from_source = false;
};
Result<LedgerMessage> decode_ledger(std::string_view bytes, const std::string& where);
Result<PoseSample> decode_pose_state(SampleHeader header, std::string_view bytes, const std::string& where);
/// A scan whose files are still to be read: file name → name of the attachment.
struct ScanMessage {
  ScanSample scan;
  std::map<std::string, std::string> attachment_of_file;
};
Result<ScanMessage> decode_scan(SampleHeader header, std::string_view bytes, const std::string& where);
Result<TransferSample> decode_transfer(SampleHeader header, std::string_view bytes, const std::string& where);

}  // namespace gnathion
