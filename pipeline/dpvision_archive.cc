// .dpvision: a zip with structure.xml and meshes. What an archive says of itself is not trusted.
#include <expat.h>
#include <fmt/format.h>
#include <zip.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <memory>
#include <optional>
#include <set>

#include "core/file.h"
#include "core/xml.h"
#include "pipeline/dpvision_workspace.h"

namespace gnathion {
namespace {

constexpr const char* kWhat = "cannot read workspace";
constexpr std::int64_t kMostEntries = 10'000;
constexpr std::uint64_t kLargestEntry = 1ull << 30, kLargestTotal = 2ull << 30, kLargestXml = 64ull << 20;
constexpr std::size_t kMostObjects = 100'000;
constexpr int kDeepest = 64;

using Zip = std::unique_ptr<zip_t, void (*)(zip_t*)>;

/// "a/b.obj", or empty where it leaves the archive.
std::string inside(std::string name) {
  for (char& c : name)
    if (c == '\\') c = '/';
  std::string out, part;
  for (const char c : name + "/") {
    if (static_cast<unsigned char>(c) < ' ') return "";
    if (c != '/') {
      part += c;
      continue;
    }
    if (part == ".." || std::count(part.begin(), part.end(), ':') > 0) return "";
    if (!part.empty() && part != ".") out += (out.empty() ? "" : "/") + part;
    part.clear();
  }
  return name.empty() || name.front() == '/' ? "" : out;
}

/// Reads entries up to limits that hold whatever the directory of the archive claims.
class Reader {
 public:
  Reader(zip_t* zip, std::string name) : zip_(zip), name_(std::move(name)) {}

  tl::unexpected<Error> bad(const std::string& why) const { return bad_input(kWhat, name_, why); }

  Status list() {
    const zip_int64_t count = zip_get_num_entries(zip_, 0);
    if (count > kMostEntries) return bad("more than 10,000 entries");
    for (zip_int64_t i = 0; i < count; ++i) {
      const char* raw = zip_get_name(zip_, static_cast<zip_uint64_t>(i), 0);
      if (raw == nullptr) return bad("an entry has no name");
      const std::string clean = inside(raw);
      if (clean.empty())
        return bad(
            fmt::format("the entry '{}' lies outside of it", valid_utf8(std::string(raw).substr(0, 80))));
      entries_[clean] = static_cast<zip_uint64_t>(i);
    }
    return {};
  }
  bool has(const std::string& name) const { return entries_.count(name) != 0; }

  Result<std::string> read(const std::string& name, std::uint64_t most) {
    const auto entry = entries_.find(name);
    if (entry == entries_.end()) return bad(name + " is not in it");
    const std::unique_ptr<zip_file_t, int (*)(zip_file_t*)> file(zip_fopen_index(zip_, entry->second, 0),
                                                                 zip_fclose);
    if (!file) return bad(name + ": " + zip_strerror(zip_));
    std::string bytes;
    std::string block(1 << 16, '\0');
    zip_int64_t n = 0;
    while ((n = zip_fread(file.get(), block.data(), block.size())) > 0) {
      bytes.append(block, 0, static_cast<std::size_t>(n));
      total_ += static_cast<std::uint64_t>(n);
      if (bytes.size() > most) return bad(fmt::format("{} unpacks to more than {} MB", name, most >> 20));
      if (total_ > kLargestTotal) return bad("unpacks to more than 2 GB in all");
    }
    if (n < 0) return bad(name + " is damaged");
    return bytes;
  }

 private:
  zip_t* zip_;
  std::string name_;
  std::map<std::string, zip_uint64_t> entries_;
  std::uint64_t total_ = 0;
};

/// One <object> as it stands.
struct Object {
  std::string id, parent, type, label, path, file;
  std::optional<Matrix4> matrix;
};

/// What expat calls while it reads structure.xml.
struct Structure {
  std::vector<Object> objects;
  std::vector<std::size_t> open;  ///< objects that enclose the place being read
  std::string text, error;
  int depth = 0;
  bool in_matrix = false, is_workspace = false;
  XML_Parser parser = nullptr;

  void stop(const std::string& why) {
    if (error.empty())
      error = fmt::format("structure.xml: line {}: {}", XML_GetCurrentLineNumber(parser), why);
    XML_StopParser(parser, XML_FALSE);
  }
};

std::string attribute(const char** attributes, std::string_view name) {
  for (; *attributes != nullptr; attributes += 2)
    if (name == attributes[0]) return attributes[1];
  return "";
}

void take_matrix(Structure& s) {
  std::array<double, 16> v{};
  const char *at = s.text.data(), *end = at + s.text.size();
  std::size_t n = 0;
  while (at != end) {
    if (static_cast<unsigned char>(*at) <= ' ' || *at == ',' || *at == ';' || *at == '[' || *at == ']') {
      ++at;
      continue;
    }
    double value = 0;
    const auto [next, ec] = std::from_chars(at, end, value);
    if (ec != std::errc() || !std::isfinite(value) || std::abs(value) > 1e7)
      return s.stop("a matrix holds what is no number of at most 1e7");
    if (n < 16) v[n] = value;
    ++n;
    at = next;
  }
  if (n != 16) return s.stop(fmt::format("a matrix has {} numbers, 16 are needed", n));
  s.objects[s.open.back()].matrix = Eigen::Map<const Eigen::Matrix<double, 4, 4, Eigen::RowMajor>>(v.data());
}

void on_start(void* user, const char* name, const char** attributes) {
  Structure& s = *static_cast<Structure*>(user);
  if (++s.depth > kDeepest) return s.stop("elements nest deeper than 64");
  const std::string_view element(name);
  if (s.depth == 1) s.is_workspace = element == "workspace";
  if (element == "object") {
    if (s.objects.size() >= kMostObjects) return s.stop("more than 100,000 objects");
    Object o{attribute(attributes, "id"),
             attribute(attributes, "parent"),
             attribute(attributes, "class") + " " + attribute(attributes, "type"),
             attribute(attributes, "label"),
             attribute(attributes, "path"),
             "",
             std::nullopt};
    if (o.parent.empty() && !s.open.empty()) o.parent = s.objects[s.open.back()].id;
    s.open.push_back(s.objects.size());
    s.objects.push_back(std::move(o));
  } else if (element == "matrix" && !s.open.empty()) {
    s.in_matrix = true;
    s.text.clear();
  } else if (element == "file" && !s.open.empty()) {
    s.objects[s.open.back()].file = attribute(attributes, "data");
  }
}

void on_end(void* user, const char* name) {
  Structure& s = *static_cast<Structure*>(user);
  --s.depth;
  const std::string_view element(name);
  if (element == "object" && !s.open.empty()) s.open.pop_back();
  if (element == "matrix" && s.in_matrix) {
    s.in_matrix = false;
    take_matrix(s);
  }
}

void on_text(void* user, const char* text, int length) {
  Structure& s = *static_cast<Structure*>(user);
  if (!s.in_matrix) return;
  s.text.append(text, static_cast<std::size_t>(length));
  if (s.text.size() > 4096) s.stop("a matrix is longer than 4 kB");
}

/// No document type: entities could grow without end.
void on_doctype(void* user, const char*, const char*, const char*, int) {
  static_cast<Structure*>(user)->stop("has a document type, which is not accepted");
}

using Children = std::multimap<std::string, std::size_t>;

Result<DpNode> node_of(const Structure& s, const Children& children, std::size_t index, int depth,
                       std::size_t& made, const std::string& name) {
  if (depth > kDeepest)
    return bad_input(kWhat, name, "structure.xml: objects nest deeper than 64, or in a loop");
  if (++made > kMostObjects) return bad_input(kWhat, name, "structure.xml: an object has several parents");
  const Object& o = s.objects[index];
  DpNode node;
  node.label = o.label;
  node.description = o.type;
  if (o.matrix) {
    node.kind = DpNode::Kind::kTransformation;
    node.matrix = *o.matrix;
  }
  if (!o.file.empty()) {
    DpNode shell;
    shell.kind = DpNode::Kind::kShell;
    shell.label = o.label;
    shell.file = inside(o.path.empty() ? o.file : o.path + "/" + o.file);
    if (shell.file.empty())
      return bad_input(
          kWhat, name,
          fmt::format("structure.xml: object {} names a file outside of it", valid_utf8(o.id.substr(0, 40))));
    if (!o.matrix) {
      shell.description = o.type;
      node = shell;
    } else {
      node.children.push_back(shell);
    }
  }
  const auto [first, last] = children.equal_range(o.id);
  for (auto it = first; it != last && !o.id.empty(); ++it) {
    GNATHION_TRY(DpNode child, node_of(s, children, it->second, depth + 1, made, name));
    node.children.push_back(std::move(child));
  }
  return node;
}

/// The name in the archive: as path and file say, or the file alone.
Status find_files(std::vector<DpNode>& nodes, Reader& reader, DpArchive& archive) {
  for (DpNode& n : nodes) {
    if (n.kind == DpNode::Kind::kShell && archive.files.count(n.file) == 0) {
      const std::string bare = n.file.substr(n.file.rfind('/') + 1);
      if (!reader.has(n.file) && reader.has(bare)) n.file = bare;
      GNATHION_TRY(archive.files[n.file], reader.read(n.file, kLargestEntry));
    }
    GNATHION_CHECK_OK(find_files(n.children, reader, archive));
  }
  return {};
}

Result<DpArchive> read_zip(zip_t* zip, const std::string& name) {
  Reader reader(zip, name);
  GNATHION_CHECK_OK(reader.list());
  if (!reader.has("structure.xml")) return bad_input(kWhat, name, "has no structure.xml");
  GNATHION_TRY(const std::string xml, reader.read("structure.xml", kLargestXml));
  DpArchive archive;
  GNATHION_TRY(archive.workspace, parse_dpvision_structure(xml, name));
  GNATHION_CHECK_OK(find_files(archive.workspace.nodes, reader, archive));
  return archive;
}

}  // namespace

Result<DpWorkspace> parse_dpvision_structure(std::string_view xml, const std::string& name) {
  if (xml.size() > kLargestXml) return bad_input(kWhat, name, "structure.xml is larger than 64 MB");
  Structure s;
  const std::unique_ptr<XML_ParserStruct, void (*)(XML_Parser)> parser(XML_ParserCreate(nullptr),
                                                                       XML_ParserFree);
  s.parser = parser.get();
  XML_SetUserData(s.parser, &s);
  XML_SetElementHandler(s.parser, on_start, on_end);
  XML_SetCharacterDataHandler(s.parser, on_text);
  XML_SetStartDoctypeDeclHandler(s.parser, on_doctype);
  const bool good = XML_Parse(s.parser, xml.data(), static_cast<int>(xml.size()), 1) == XML_STATUS_OK;
  if (!s.error.empty()) return bad_input(kWhat, name, s.error);
  if (!good)
    return bad_input(
        kWhat, name,
        fmt::format("structure.xml: line {}, column {}: {}", XML_GetCurrentLineNumber(s.parser),
                    XML_GetCurrentColumnNumber(s.parser) + 1, XML_ErrorString(XML_GetErrorCode(s.parser))));
  if (!s.is_workspace) return bad_input(kWhat, name, "structure.xml: its root is not <workspace>");

  std::set<std::string> ids;
  for (const Object& o : s.objects)
    if (!o.id.empty() && !ids.insert(o.id).second)
      return bad_input(
          kWhat, name,
          fmt::format("structure.xml: two objects have the id {}", valid_utf8(o.id.substr(0, 40))));
  Children children;
  std::vector<std::size_t> roots;
  for (std::size_t i = 0; i < s.objects.size(); ++i) {
    const std::string& parent = s.objects[i].parent;
    if (!parent.empty() && ids.count(parent) != 0)
      children.emplace(parent, i);
    else
      roots.push_back(i);
  }
  DpWorkspace workspace;
  std::size_t made = 0;
  for (const std::size_t i : roots) {
    GNATHION_TRY(DpNode node, node_of(s, children, i, 0, made, name));
    workspace.nodes.push_back(std::move(node));
  }
  if (made != s.objects.size()) return bad_input(kWhat, name, "structure.xml: parents make a loop");
  return workspace;
}

Result<DpArchive> read_dpvision(const std::filesystem::path& path) {
  std::error_code ec;
  if (!std::filesystem::is_regular_file(path, ec)) return bad_input(kWhat, path.string(), "is not a file");
  int code = 0;
  const Zip zip(zip_open(path.c_str(), ZIP_RDONLY, &code), zip_discard);
  if (!zip) return bad_input(kWhat, path.string(), "is no zip, or a damaged one");
  return read_zip(zip.get(), path.string());
}

Result<DpArchive> parse_dpvision(std::string_view bytes, const std::string& name) {
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* source = zip_source_buffer_create(bytes.data(), bytes.size(), 0, &error);
  Zip zip(source == nullptr ? nullptr : zip_open_from_source(source, ZIP_RDONLY, &error), zip_discard);
  if (!zip && source != nullptr) zip_source_free(source);
  zip_error_fini(&error);
  if (!zip) return bad_input(kWhat, name, "is no zip, or a damaged one");
  return read_zip(zip.get(), name);
}

}  // namespace gnathion
