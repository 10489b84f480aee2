// OpenIGTLink messages written by the OpenIGTLink library: the independent other side of the decoder.
#pragma once

#include <igtlImageMessage.h>
#include <igtlPolyDataMessage.h>
#include <igtlQuaternionTrackingDataMessage.h>
#include <igtlStatusMessage.h>
#include <igtlTimeStamp.h>
#include <igtlTrackingDataMessage.h>
#include <igtlTransformMessage.h>

#include <string>
#include <vector>

#include "acquisition/igtl/igtl_bytes.h"
#include "acquisition/igtl/igtl_protocol.h"
#include "core/image.h"
#include "core/rigid.h"

namespace gnathion::igtl_pack {

inline std::string packed(::igtl::MessageBase* message, const std::string& device, std::int64_t time_ns) {
  message->SetDeviceName(device.c_str());
  if (time_ns != 0) {
    auto stamp = ::igtl::TimeStamp::New();
    stamp->SetTime(static_cast<igtlUint32>(time_ns / 1'000'000'000),
                   static_cast<igtlUint32>(time_ns % 1'000'000'000));
    message->SetTimeStamp(stamp);
  }
  message->Pack();
  return {static_cast<const char*>(message->GetPackPointer()),
          static_cast<std::size_t>(message->GetPackSize())};
}

inline void fill(::igtl::Matrix4x4& to, const Matrix4& from) {
  for (int i = 0; i < 4; ++i)
    for (int j = 0; j < 4; ++j) to[i][j] = static_cast<float>(from(i, j));
}

inline std::string transform(const std::string& device, const Matrix4& m, std::int64_t time_ns) {
  auto message = ::igtl::TransformMessage::New();
  ::igtl::Matrix4x4 matrix;
  fill(matrix, m);
  message->SetMatrix(matrix);
  return packed(message, device, time_ns);
}

struct Tool {
  std::string name;
  Rigid3 pose;
  int type = 2;  ///< 6D
};

inline std::string tdata(const std::string& device, const std::vector<Tool>& tools, std::int64_t time_ns) {
  auto message = ::igtl::TrackingDataMessage::New();
  for (const Tool& tool : tools) {
    auto element = ::igtl::TrackingDataElement::New();
    element->SetName(tool.name.c_str());
    element->SetType(static_cast<igtlUint8>(tool.type));
    ::igtl::Matrix4x4 matrix;
    fill(matrix, tool.pose.matrix());
    element->SetMatrix(matrix);
    message->AddTrackingDataElement(element);
  }
  return packed(message, device, time_ns);
}

inline std::string qtdata(const std::string& device, const std::vector<Tool>& tools, std::int64_t time_ns) {
  auto message = ::igtl::QuaternionTrackingDataMessage::New();
  for (const Tool& tool : tools) {
    auto element = ::igtl::QuaternionTrackingDataElement::New();
    element->SetName(tool.name.c_str());
    element->SetType(static_cast<igtlUint8>(tool.type));
    const Vector3& t = tool.pose.translation_mm;
    element->SetPosition(static_cast<float>(t.x()), static_cast<float>(t.y()), static_cast<float>(t.z()));
    const Eigen::Quaterniond q(tool.pose.rotation);
    element->SetQuaternion(static_cast<float>(q.x()), static_cast<float>(q.y()), static_cast<float>(q.z()),
                           static_cast<float>(q.w()));
    message->AddQuaternionTrackingDataElement(element);
  }
  return packed(message, device, time_ns);
}

/// `bytes` are the scalars as the type wants them; `components` of them a pixel.
inline std::string image(const std::string& device, int width, int height, int slices, int scalar_type,
                         int components, const std::string& bytes, std::int64_t time_ns) {
  auto message = ::igtl::ImageMessage::New();
  message->SetDimensions(width, height, slices);
  message->SetScalarType(scalar_type);
  message->SetNumComponents(components);
  message->AllocateScalars();
  std::copy(bytes.begin(), bytes.end(), static_cast<char*>(message->GetScalarPointer()));
  return packed(message, device, time_ns);
}
inline std::string image(const std::string& device, const Image8& picture, std::int64_t time_ns) {
  return image(device, picture.width_px, picture.height_px, 1, ::igtl::ImageMessage::TYPE_UINT8, 1,
               std::string(picture.pixels.begin(), picture.pixels.end()), time_ns);
}

inline std::string status(const std::string& device, int code, const std::string& name,
                          const std::string& text, std::int64_t time_ns) {
  auto message = ::igtl::StatusMessage::New();
  message->SetCode(code);
  message->SetSubCode(128);
  message->SetErrorName(name.c_str());
  message->SetStatusString(text.c_str());
  return packed(message, device, time_ns);
}

/// The same message as protocol 2 and later send it: extended header before the content, metadata behind it.
/// Debian's library knows the first version only, so this follows the protocol's page by hand.
inline std::string with_extended_header(
    const std::string& message, std::uint32_t id,
    const std::vector<std::pair<std::string, std::string>>& metadata = {}) {
  using igtl::append_big_endian;
  const std::string content = message.substr(igtl::kHeaderBytes);
  std::string index, values, body;
  append_big_endian(index, metadata.size(), 2);
  for (const auto& [key, value] : metadata) {
    append_big_endian(index, key.size(), 2);
    append_big_endian(index, 3, 2);  // US-ASCII
    append_big_endian(index, value.size(), 4);
    values += key + value;
  }
  append_big_endian(body, 12, 2);
  append_big_endian(body, index.size(), 2);
  append_big_endian(body, values.size(), 4);
  append_big_endian(body, id, 4);
  body += content + index + values;
  std::string header = message.substr(0, 42);
  header[0] = 0;
  header[1] = 2;
  append_big_endian(header, body.size(), 8);
  append_big_endian(header, igtl::crc64(body), 8);
  return header + body;
}

}  // namespace gnathion::igtl_pack
