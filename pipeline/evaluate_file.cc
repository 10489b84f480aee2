// evaluation.toml (docs/evaluation.md).
#include <fmt/format.h>

#include <functional>
#include <map>

#include "core/file.h"
#include "pipeline/evaluate_job.h"
#include "pipeline/toml_file.h"

namespace gnathion {
namespace fs = std::filesystem;
namespace {

constexpr const char* kWhat = "cannot read evaluation";

struct Reader {
  std::string name;
  fs::path folder;

  tl::unexpected<Error> refuse(const std::string& why) const { return bad_input(kWhat, name, why); }
  using Take = std::function<Status(const toml::node&)>;
  using Keys = std::map<std::string, Take>;

  Status table(const toml::table& t, const std::string& section, const Keys& keys) const {
    for (const auto& [key, node] : t) {
      const auto take = keys.find(std::string(key.str()));
      if (take == keys.end()) return refuse(fmt::format("unknown key '{}' in {}", key.str(), section));
      const Status taken = take->second(node);
      if (!taken) return refuse(fmt::format("'{}' in {}: {}", key.str(), section, taken.error().why));
    }
    return {};
  }
  Take path(fs::path& out, bool is_folder = false) const {
    return [this, &out, is_folder](const toml::node& node) -> Status {
      const auto value = node.value<std::string>();
      if (!value || value->empty()) return refuse("is not a path");
      out = folder / *value;
      std::error_code ec;
      if (is_folder ? !fs::is_directory(out, ec) : !fs::is_regular_file(out, ec))
        return refuse(fmt::format("{} does not exist", *value));
      return {};
    };
  }
  Take text(std::string& out) const {
    return [this, &out](const toml::node& node) -> Status {
      // Numbers are names too.
      if (const auto number = node.value_exact<std::int64_t>()) {
        out = std::to_string(*number);
        return {};
      }
      const auto value = node.value<std::string>();
      if (!value || value->empty()) return refuse("is not a text");
      out = *value;
      return {};
    };
  }
  template <class T>
  Take number(T& out, double low, double high) const {
    return [this, &out, low, high](const toml::node& node) -> Status {
      const auto value = node.value<double>();
      if (!value) return refuse("is not a number");
      if (!(*value >= low && *value <= high))
        return refuse(fmt::format("must lie in {:g} to {:g}", low, high));
      using Number = std::conditional_t<std::is_same_v<T, std::optional<double>>, double, T>;
      out = static_cast<Number>(*value);
      return {};
    };
  }
  Take flag(bool& out) const {
    return [this, &out](const toml::node& node) -> Status {
      const auto value = node.value<bool>();
      if (!value) return refuse("is not true or false");
      out = *value;
      return {};
    };
  }
  template <class T>
  Take choice(T& out, const std::map<std::string, T>& values) const {
    return [this, &out, values](const toml::node& node) -> Status {
      const auto found = values.find(node.value_or(std::string()));
      if (found == values.end()) {
        std::string names;
        for (const auto& [key, value] : values) names += (names.empty() ? "" : ", ") + key;
        return refuse("must be one of " + names);
      }
      out = found->second;
      return {};
    };
  }
};

Status read_splint(const Reader& r, const toml::node& node, EvaluateJob& job) {
  const toml::table* t = node.as_table();
  if (t == nullptr) return r.refuse("[[splint]] is not a table");
  EvaluateSplint s;
  GNATHION_CHECK_OK(
      r.table(*t, "[[splint]]",
              {{"name", r.text(s.name)},
               {"design", r.path(s.design, true)},
               {"maxilla", r.path(s.maxilla)},
               {"mandible", r.path(s.mandible)},
               {"transform", r.path(s.transform)},
               {"mandible_pose", r.choice<bool>(s.mandible_is_in_tp, {{"mi", false}, {"tp", true}})},
               {"scan_splint", r.path(s.scan_splint)},
               {"scan_maxilla", r.path(s.scan_maxilla)},
               {"scan_mandible", r.path(s.scan_mandible)},
               {"scan_splint_free", r.path(s.scan_splint_free)}}));
  if (s.design.empty()) return r.refuse("[[splint]] without design");
  if (s.scan_splint.empty()) return r.refuse("[[splint]] without scan_splint");
  if (s.name.empty()) s.name = fs::weakly_canonical(s.design).filename().string();
  job.splints.push_back(std::move(s));
  return {};
}

Reader::Take tables_of(const Reader& r, const Reader::Keys& keys, const std::string& section) {
  return [&r, keys, section](const toml::node& node) -> Status {
    if (!node.is_table()) return r.refuse("is not a table");
    return r.table(*node.as_table(), section, keys);
  };
}

}  // namespace

Result<EvaluateJob> read_evaluation_file(const fs::path& path) {
  GNATHION_TRY(const toml::table t, read_toml(path, kWhat));
  const Reader r{path.string(), path.parent_path()};
  EvaluateJob job;
  job.config = path;
  EvaluationOptions& e = job.options;
  StatisticsOptions& s = job.statistics;
  EvaluationTolerance& tol = job.tolerance;
  const Reader::Keys evaluation = {
      {"seat_region", r.choice<SeatRegion>(e.seat_region, {{"auto", SeatRegion::kAuto},
                                                           {"palate", SeatRegion::kPalate},
                                                           {"crowns", SeatRegion::kCrowns},
                                                           {"whole", SeatRegion::kWhole}})},
      {"reach_mm", r.number(e.reach_mm, 0.5, 10.0)},
      {"rim_mm", r.number(e.rim_mm, 0.0, 5.0)},
      {"steep_deg", r.number(e.steep_deg, 10.0, 180.0)},
      {"noise_mm", r.number(e.noise_mm, 0.001, 1.0)},
      {"points", r.number(e.points, 500, 200000)},
      {"seed", r.number(e.seed, 0, 9e15)},
      {"integrity", r.flag(e.integrity)},
      {"pictures", r.flag(job.pictures)}};
  const Reader::Keys statistics = {{"outlier_z", r.number(s.outlier_z, 1.0, 100.0)},
                                   {"resamples", r.number(s.resamples, 100, 1e6)},
                                   {"seed", r.number(s.seed, 0, 9e15)}};
  const Reader::Keys tolerance = {{"avg_mm", r.number(tol.avg_mm, 0.0, 100.0)},
                                  {"std_mm", r.number(tol.std_mm, 0.0, 100.0)},
                                  {"alpha_deg", r.number(tol.alpha_deg, 0.0, 180.0)},
                                  {"t_mm", r.number(tol.t_mm, 0.0, 100.0)},
                                  {"max_tooth_mm", r.number(tol.max_tooth_mm, 0.0, 100.0)},
                                  {"equivalence_mm", r.number(tol.equivalence_mm, 1e-6, 100.0)}};
  const auto list = [&](const toml::node& node, const auto& each) -> Status {
    const toml::array* items = node.as_array();
    if (items == nullptr) return r.refuse("is not a list");
    for (const toml::node& item : *items) GNATHION_CHECK_OK(each(item));
    return {};
  };
  const Reader::Keys top = {{"splint",
                             [&](const toml::node& node) {
                               return list(node,
                                           [&](const toml::node& item) { return read_splint(r, item, job); });
                             }},
                            {"other_designs",
                             [&](const toml::node& node) {
                               return list(node, [&](const toml::node& item) -> Status {
                                 fs::path folder;
                                 GNATHION_CHECK_OK(r.path(folder, true)(item));
                                 job.other_designs.push_back(folder);
                                 return {};
                               });
                             }},
                            {"evaluation", tables_of(r, evaluation, "[evaluation]")},
                            {"statistics", tables_of(r, statistics, "[statistics]")},
                            {"tolerance", tables_of(r, tolerance, "[tolerance]")}};
  GNATHION_CHECK_OK(r.table(t, "the file", top));
  if (job.splints.empty()) return r.refuse("no [[splint]]");
  return job;
}

}  // namespace gnathion
