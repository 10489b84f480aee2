#include "design/write_3mf.h"

#include <cstdint>
#include <iterator>

#include <fmt/format.h>
#include <zlib.h>

#include "core/file.h"
#include "core/xml.h"

namespace gnathion {
namespace {

std::string model_xml(const TriangleMesh& mesh,
                      const std::vector<std::pair<std::string, std::string>>& metadata) {
  std::string xml =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<model unit=\"millimeter\" xml:lang=\"en-US\" "
      "xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" "
      "xmlns:gnathion=\"https://gnathion.example/3mf/2026\">\n"
      " <metadata name=\"Application\">Gnathion</metadata>\n";
  for (const auto& [name, value] : metadata)
    xml +=
        fmt::format(" <metadata name=\"gnathion:{}\">{}</metadata>\n", xml_escaped(name), xml_escaped(value));
  xml += " <resources>\n  <object id=\"1\" type=\"model\" name=\"splint\">\n   <mesh>\n    <vertices>\n";
  auto to = std::back_inserter(xml);
  for (const Vector3& v : mesh.vertices_mm)
    fmt::format_to(to, "     <vertex x=\"{:.5f}\" y=\"{:.5f}\" z=\"{:.5f}\"/>\n", v.x(), v.y(), v.z());
  xml += "    </vertices>\n    <triangles>\n";
  for (const Triangle& t : mesh.triangles)
    fmt::format_to(to, "     <triangle v1=\"{}\" v2=\"{}\" v3=\"{}\"/>\n", t[0], t[1], t[2]);
  xml +=
      "    </triangles>\n   </mesh>\n  </object>\n </resources>\n <build>\n  <item objectid=\"1\"/>\n "
      "</build>\n"
      "</model>\n";
  return xml;
}

/// A zip archive of deflated entries with a fixed date (1 January 1980, the format's first).
class Zip {
 public:
  Status add(const std::string& name, const std::string& bytes) {
    std::string packed(compressBound(bytes.size()) + 16, '\0');
    z_stream stream{};
    if (deflateInit2(&stream, 4, Z_DEFLATED, -15, 8, Z_DEFAULT_STRATEGY) != Z_OK)
      return fail(ErrorCode::kInternal, "cannot write 3MF", name, "deflate does not start");
    stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(bytes.data()));
    stream.avail_in = static_cast<uInt>(bytes.size());
    stream.next_out = reinterpret_cast<Bytef*>(packed.data());
    stream.avail_out = static_cast<uInt>(packed.size());
    const int status = deflate(&stream, Z_FINISH);
    packed.resize(stream.total_out);
    deflateEnd(&stream);
    if (status != Z_STREAM_END) return fail(ErrorCode::kInternal, "cannot write 3MF", name, "deflate failed");

    const auto crc = static_cast<std::uint32_t>(crc32(
        crc32(0, nullptr, 0), reinterpret_cast<const Bytef*>(bytes.data()), static_cast<uInt>(bytes.size())));
    std::string common;  // the part that local and central headers share
    for (const std::uint32_t v : {20U, 0U, 8U, 0U, 33U}) put(common, v, 2);
    put(common, crc, 4);
    put(common, static_cast<std::uint32_t>(packed.size()), 4);
    put(common, static_cast<std::uint32_t>(bytes.size()), 4);
    put(common, static_cast<std::uint32_t>(name.size()), 2);
    put(common, 0, 2);
    put(central_, 0x02014b50, 4);
    put(central_, 20, 2);
    central_ += common;
    for (const std::uint32_t size : {2U, 2U, 2U, 4U}) put(central_, 0, static_cast<int>(size));
    put(central_, static_cast<std::uint32_t>(body_.size()), 4);
    central_ += name;
    put(body_, 0x04034b50, 4);
    body_ += common + name + packed;
    ++entries_;
    return {};
  }

  std::string finished() const {
    std::string out = body_ + central_;
    put(out, 0x06054b50, 4);
    for (const std::uint32_t v : {0U, 0U, entries_, entries_}) put(out, v, 2);
    put(out, static_cast<std::uint32_t>(central_.size()), 4);
    put(out, static_cast<std::uint32_t>(body_.size()), 4);
    put(out, 0, 2);
    return out;
  }

 private:
  static void put(std::string& to, std::uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) to += static_cast<char>(value >> (8 * i) & 0xff);
  }
  std::string body_, central_;
  std::uint32_t entries_ = 0;
};

constexpr const char* kContentTypes =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<Types xmlns=\"http://schemas.openxmlformats.org/package/2006/content-types\">"
    "<Default Extension=\"rels\" ContentType=\"application/vnd.openxmlformats-package.relationships+xml\"/>"
    "<Default Extension=\"model\" ContentType=\"application/vnd.ms-package.3dmanufacturing-3dmodel+xml\"/>"
    "</Types>\n";
constexpr const char* kRelations =
    "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
    "<Relationships xmlns=\"http://schemas.openxmlformats.org/package/2006/relationships\">"
    "<Relationship Target=\"/3D/3dmodel.model\" Id=\"rel0\" "
    "Type=\"http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel\"/></Relationships>\n";

}  // namespace

Status write_3mf(const std::filesystem::path& path, const TriangleMesh& mesh,
                 const std::vector<std::pair<std::string, std::string>>& metadata) {
  Zip zip;
  GNATHION_CHECK_OK(zip.add("[Content_Types].xml", kContentTypes));
  GNATHION_CHECK_OK(zip.add("_rels/.rels", kRelations));
  GNATHION_CHECK_OK(zip.add("3D/3dmodel.model", model_xml(mesh, metadata)));
  return write_file(path, zip.finished());
}

}  // namespace gnathion
