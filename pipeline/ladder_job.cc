#include "pipeline/ladder_job.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "pipeline/nested_progress.h"

namespace gnathion {
namespace {

using nlohmann::json;

constexpr char kWhat[] = "cannot design ladder";
constexpr std::size_t kMostRungs = 64;

std::vector<double> ascending(std::vector<double> values) {
  for (double& v : values) v = std::round(v * 1000.0) / 1000.0;
  std::sort(values.begin(), values.end());
  values.erase(std::unique(values.begin(), values.end()), values.end());
  return values;
}

json rung_json(const std::string& name, const SplintParameters& p, const DesignOutcome& outcome) {
  json rung = {{"folder", name},
               {"engagement_mm", p.engagement_mm},
               {"gap_mm", p.gap_mm},
               {"verdict", outcome.report->value("verdict", "")},
               {"violated", (*outcome.report)["violated"]},
               {"label", nullptr},
               {"retention_area_mm2", nullptr},
               {"insertability_mm", nullptr},
               {"seat_gap_median_mm", nullptr},
               {"volume_mm3", nullptr}};
  if (!outcome.design) return rung;
  const SplintVerification& v = outcome.design->verification;
  if (outcome.design->label) rung["label"] = outcome.design->label->text;
  rung["retention_area_mm2"] = v.retention_area_mm2;
  rung["insertability_mm"] = v.insertability.deepest_mm;
  rung["seat_gap_median_mm"] = v.seat_gap.median_mm;
  rung["volume_mm3"] = v.volume_mm3;
  return rung;
}

std::string rung_line(const std::string& name, const DesignOutcome& outcome) {
  if (!outcome.design) return fmt::format("  {:<16} {}\n", name, outcome.report->value("verdict", ""));
  const SplintVerification& v = outcome.design->verification;
  return fmt::format("  {:<16} {:<6} retentive {:7.2f} mm2, passes {:.3f} mm deep, gap {:.3f} mm\n", name,
                     outcome.design->verdict, v.retention_area_mm2, v.insertability.deepest_mm,
                     v.seat_gap.median_mm);
}

}  // namespace

Result<LadderOutcome> run_ladder(const DesignJob& job, const Ladder& ladder,
                                 const std::filesystem::path& folder, Progress& progress) {
  if (!job.edits.label.empty())
    return fail(ErrorCode::kUsage, kWhat, "--label", "each rung is labelled with its r and g: leave it out");
  const std::vector<double> engagements = ascending(ladder.engagement_mm), gaps = ascending(ladder.gap_mm);
  const std::size_t rungs = engagements.size() * gaps.size();
  if (rungs == 0 || rungs > kMostRungs)
    return fail(ErrorCode::kUsage, kWhat, "--engagement, --gap",
                fmt::format("{} rungs: 1 to {} can be made", rungs, kMostRungs));
  LadderOutcome outcome;
  json list = json::array();
  for (const double r : engagements)
    for (const double g : gaps) {
      DesignJob one = job;
      one.parameters.engagement_mm = r;
      one.parameters.gap_mm = g;
      GNATHION_CHECK_OK(check_parameters(one.parameters));
      const std::string name = fmt::format("r{:.3f}_g{:.3f}", r, g);
      // In µm, so that the rungs can be told apart after printing.
      one.edits.label = fmt::format("R{:.0f} G{:.0f}", 1000.0 * r, 1000.0 * g);
      std::error_code ec;
      if (!std::filesystem::create_directory(folder / name, ec))
        return fail(ErrorCode::kInternal, kWhat, (folder / name).string(), ec.message());
      NestedProgress building(progress, name, 1.0 / static_cast<double>(rungs));
      GNATHION_TRY(const DesignOutcome rung, run_design(one, folder / name, building));
      list.push_back(rung_json(name, one.parameters, rung));
      outcome.table += rung_line(name, rung);
      outcome.accepted += rung.accepted();
      ++outcome.rungs;
    }
  outcome.report = std::make_shared<json>(
      json{{"kind", "retention ladder"}, {"rungs", list}, {"accepted", outcome.accepted}});
  GNATHION_CHECK_OK(write_json(folder / "ladder.json", *outcome.report));
  return outcome;
}

}  // namespace gnathion
