#include "pipeline/provenance.h"

#include <fmt/format.h>
#include <openssl/evp.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "core/file.h"
#include "core/transform_io.h"
#include "pipeline/case_file.h"
#include "pipeline/case_roles.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

using nlohmann::json;
constexpr const char* kNotCompared = "not compared: it lies outside the case";

json file_json(const FileRecord& f) {
  json j = {{"path", f.path}, {"sha256", f.sha256}};
  if (!f.role.empty()) j[f.from_step ? "step" : "role"] = f.role;
  if (f.outside) j["outside"] = true;
  return j;
}

Result<std::string> sha256_of_stream(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) return bad_input("cannot read", path.string(), "does not exist or may not be read");
  const std::unique_ptr<EVP_MD_CTX, void (*)(EVP_MD_CTX*)> context(EVP_MD_CTX_new(), EVP_MD_CTX_free);
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned int length = 0;
  bool good = context && EVP_DigestInit_ex(context.get(), EVP_sha256(), nullptr) == 1;
  std::vector<char> block(1 << 20);
  while (good && (in.read(block.data(), static_cast<std::streamsize>(block.size())) || in.gcount() > 0))
    good = EVP_DigestUpdate(context.get(), block.data(), static_cast<std::size_t>(in.gcount())) == 1;
  if (in.bad()) return bad_input("cannot read", path.string(), "reading failed");
  good = good && EVP_DigestFinal_ex(context.get(), digest.data(), &length) == 1;
  if (!good) return fail(ErrorCode::kInternal, "cannot hash", path.string(), "SHA-256 is not to be had");
  std::string hex;
  for (unsigned int i = 0; i < length; ++i) hex += fmt::format("{:02x}", digest[i]);
  return hex;
}

/// Goes back from files to what they were made from.
class Tracer {
 public:
  Tracer(fs::path folder, const Provenance& p) : folder_(std::move(folder)) {
    for (const StepRecord& s : p.steps) {
      steps_[s.step] = &s;
      for (const FileRecord& o : s.outputs) maker_[o.path] = &s;
    }
  }

  Result<ProvenanceNode> trace(const std::string& result) {
    const auto made = maker_.find(result);
    if (made == maker_.end())
      return bad_input("cannot trace", (folder_ / "results" / result).string(),
                       "no step of `gnathion run` made it");
    ProvenanceNode node;
    node.file = "results/" + result;
    node.made_by = *made->second;
    for (const FileRecord& o : made->second->outputs)
      if (o.path == result) node.sha256 = o.sha256;
    node.state = state_of(folder_ / "results" / result, node.sha256);
    for (const FileRecord& in : made->second->inputs) {
      if (in.from_step) {
        GNATHION_TRY(ProvenanceNode from, trace(in.path));
        node.from.push_back(std::move(from));
        continue;
      }
      ProvenanceNode leaf;
      leaf.file = in.path;
      leaf.sha256 = in.sha256;
      const fs::path place =
          in.outside ? outside(in.role) : folder_ / in.path;  // an absolute one stays as it is
      leaf.state = place.empty() ? kNotCompared : state_of(place, in.sha256);
      node.from.push_back(std::move(leaf));
    }
    return node;
  }

 private:
  std::string state_of(const fs::path& path, const std::string& then) {
    const auto known = states_.find(path.string());
    if (known != states_.end()) return known->second;
    std::error_code ec;
    std::string state = "is gone";
    if (fs::exists(path, ec)) {
      const auto now = sha256_of(path);
      state = !now ? "cannot be read" : *now == then ? "unchanged" : "changed since";
    }
    return states_[path.string()] = state;
  }

  /// Where case.toml says that a file lies; empty: it does not say.
  fs::path outside(const std::string& role) const {
    const CaseRole* known = find_case_role(role);
    const auto files = read_unfinished_case(folder_);
    return known && files ? (*files).*(known->member) : fs::path();
  }

  fs::path folder_;
  std::map<std::string, const StepRecord*> steps_, maker_;
  std::map<std::string, std::string> states_;
};

void print(const ProvenanceNode& node, const std::string& indent, const char* mark,
           std::set<std::string>& shown, std::string& text) {
  text +=
      fmt::format("{}{}{}  {}  {}\n", indent, mark, node.file, node.sha256.substr(0, 12),
                  node.state == "unchanged" || node.state == kNotCompared ? node.state : "*** " + node.state);
  const std::string below = indent + (*mark == 0 ? "" : "   ");
  if (node.made_by.step.empty()) return;
  text += fmt::format("{}   by {} {} of gnathion {}, {}\n", below, node.made_by.step, node.made_by.version,
                      node.made_by.program, node.made_by.time);
  if (!shown.insert(node.made_by.step).second) {
    text += below + "   from what is told above\n";
    return;
  }
  if (!node.made_by.parameters.empty() && node.made_by.parameters != "{}")
    text += fmt::format("{}   with {}\n", below, node.made_by.parameters);
  for (const std::string& fact : node.made_by.facts) text += fmt::format("{}   {}\n", below, fact);
  for (const ProvenanceNode& n : node.from) print(n, below, "-- ", shown, text);
}

void collect_changed(const ProvenanceNode& node, std::set<std::string>& files) {
  if (node.state != "unchanged" && node.state != kNotCompared) files.insert(node.file + " " + node.state);
  for (const ProvenanceNode& n : node.from) collect_changed(n, files);
}

json node_json(const ProvenanceNode& node) {
  json j = {{"file", node.file}, {"sha256", node.sha256}, {"state", node.state}};
  if (node.made_by.step.empty()) return j;
  j["step"] = node.made_by.step;
  j["step_version"] = node.made_by.version;
  j["version"] = node.made_by.program;
  j["time"] = node.made_by.time;
  j["parameters"] = json::parse(node.made_by.parameters, nullptr, false);
  j["facts"] = node.made_by.facts;
  j["from"] = json::array();
  for (const ProvenanceNode& n : node.from) j["from"].push_back(node_json(n));
  return j;
}

}  // namespace

Result<std::string> sha256_of(const fs::path& path) {
  std::error_code ec;
  if (!fs::is_directory(path, ec)) return sha256_of_stream(path);
  std::vector<std::string> names;
  for (auto it = fs::recursive_directory_iterator(path, ec); !ec && it != fs::recursive_directory_iterator();
       it.increment(ec))
    if (it->is_regular_file()) names.push_back(it->path().lexically_relative(path).generic_string());
  if (ec) return bad_input("cannot read", path.string(), ec.message());
  std::sort(names.begin(), names.end());
  std::string all;
  for (const std::string& name : names) {
    GNATHION_TRY(const std::string one, sha256_of_stream(path / name));
    all += one + " " + name + "\n";
  }
  return sha256_hex(all);
}

json step_json(const StepRecord& r) {
  json inputs = json::array(), outputs = json::array();
  for (const FileRecord& f : r.inputs) inputs.push_back(file_json(f));
  for (const FileRecord& f : r.outputs) outputs.push_back(file_json(f));
  return {{"step", r.step},
          {"key", r.key},
          {"version", r.program},
          {"step_version", r.version},
          {"build", r.build},
          {"time", r.time},
          {"parameters", json::parse(r.parameters.empty() ? "{}" : r.parameters)},
          {"inputs", inputs},
          {"outputs", outputs},
          {"facts", r.facts}};
}

Result<StepRecord> step_from_json(const json& j, const std::string& where) {
  try {
    StepRecord r;
    r.step = j.at("step").get<std::string>();
    r.key = j.at("key").get<std::string>();
    r.program = j.at("version").get<std::string>();
    r.version = j.at("step_version").get<int>();
    r.build = j.value("build", std::string());
    r.time = j.at("time").get<std::string>();
    r.parameters = j.at("parameters").dump();
    for (const json& f : j.at("inputs")) {
      const bool step = f.contains("step");
      r.inputs.push_back({f.at(step ? "step" : "role").get<std::string>(), f.at("path").get<std::string>(),
                          f.at("sha256").get<std::string>(), step, f.value("outside", false)});
    }
    for (const json& f : j.at("outputs"))
      r.outputs.push_back({"", f.at("path").get<std::string>(), f.at("sha256").get<std::string>()});
    for (const json& f : j.at("facts")) r.facts.push_back(f.get<std::string>());
    return r;
  } catch (const json::exception& e) {
    return bad_input("cannot read provenance", where, e.what());
  }
}

json provenance_json(const Provenance& p) {
  json j = {{"kind", "provenance"},
            {"case", p.case_id},
            {"version", p.program},
            {"time", p.time},
            {"steps", json::array()}};
  for (const StepRecord& s : p.steps) j["steps"].push_back(step_json(s));
  return j;
}

Result<Provenance> read_provenance(const fs::path& case_folder) {
  const fs::path path = case_folder / "results" / "provenance.json";
  std::error_code ec;
  if (!fs::exists(path, ec))
    return bad_input("cannot read provenance", case_folder.string(),
                     "the case was not run; `gnathion run` does");
  GNATHION_TRY(const json j, read_json(path));
  if (!j.is_object() || j.value("kind", json()) != "provenance" || !j.contains("steps") ||
      !j["steps"].is_array())
    return bad_input("cannot read provenance", path.string(), "is no provenance file");
  Provenance p;
  for (const auto& [key, to] : {std::pair{"case", &p.case_id}, {"version", &p.program}, {"time", &p.time}})
    if (j.contains(key) && j[key].is_string()) *to = j[key].get<std::string>();
  std::set<std::string> before;
  for (const json& s : j["steps"]) {
    GNATHION_TRY(StepRecord record, step_from_json(s, path.string()));
    // A step builds on earlier ones only; a file that says otherwise would send a reader round for ever.
    for (const FileRecord& in : record.inputs)
      if (in.from_step && before.count(in.path) == 0)
        return bad_input("cannot read provenance", path.string(),
                         fmt::format("'{}' uses {}, which no earlier step made", record.step, in.path));
    for (const FileRecord& out : record.outputs) before.insert(out.path);
    p.steps.push_back(std::move(record));
  }
  return p;
}

Result<std::vector<ProvenanceNode>> trace_provenance(const fs::path& case_folder, const std::string& result) {
  GNATHION_TRY(const Provenance p, read_provenance(case_folder));
  Tracer tracer(case_folder, p);
  std::vector<ProvenanceNode> trees;
  std::string name = result;
  if (name.rfind("results/", 0) == 0) name.erase(0, 8);
  if (!name.empty()) {
    GNATHION_TRY(ProvenanceNode node, tracer.trace(name));
    trees.push_back(std::move(node));
    return trees;
  }
  std::set<std::string> used;
  for (const StepRecord& s : p.steps)
    for (const FileRecord& in : s.inputs)
      if (in.from_step) used.insert(in.path);
  for (const StepRecord& s : p.steps)
    for (const FileRecord& out : s.outputs)
      if (used.count(out.path) == 0) {
        GNATHION_TRY(ProvenanceNode node, tracer.trace(out.path));
        trees.push_back(std::move(node));
      }
  return trees;
}

std::string provenance_text(const std::vector<ProvenanceNode>& tree) {
  std::string text;
  std::set<std::string> shown;
  for (const ProvenanceNode& node : tree) print(node, "", "", shown, text);
  return text;
}

json provenance_tree_json(const std::vector<ProvenanceNode>& tree) {
  json j = json::array();
  for (const ProvenanceNode& node : tree) j.push_back(node_json(node));
  return j;
}

std::vector<std::string> changed_files(const std::vector<ProvenanceNode>& tree) {
  std::set<std::string> files;
  for (const ProvenanceNode& node : tree) collect_changed(node, files);
  return {files.begin(), files.end()};
}

}  // namespace gnathion
