#include "acquisition/session_json.h"

#include <nlohmann/json.hpp>

namespace gnathion {
namespace {

using nlohmann::json;

std::string text_of(const json& j) {
  return j.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

json device_json(const DeviceDescription& d) {
  return {{"kind", d.kind},     {"stream", d.stream},     {"vendor", d.vendor},    {"model", d.model},
          {"serial", d.serial}, {"settings", d.settings}, {"warnings", d.warnings}};
}

json clock_json(const ClockEstimate& c) {
  if (!c.known) return nullptr;
  return {{"offset_ns", c.offset_ns}, {"reference_ns", c.reference_ns}, {"drift_ppm", c.drift_ppm},
          {"jitter_ms", c.jitter_ms}, {"samples", c.samples},           {"outliers", c.outliers}};
}

}  // namespace

std::string session_start_json(const SessionOptions& options, const std::vector<DeviceDescription>& devices) {
  json list = json::array();
  for (const DeviceDescription& d : devices) list.push_back(device_json(d));
  return text_of({{"software_version", options.software_version},
                  {"devices", list},
                  {"queue_bytes", options.queue_bytes},
                  {"reserve_bytes", options.reserve_bytes},
                  {"sync_interval_ms", options.sync_interval_ms},
                  {"compression", options.recording.compression},
                  {"max_chunk_ns", options.recording.max_chunk_ns},
                  {"max_chunk_bytes", options.recording.max_chunk_bytes}});
}

std::string session_end_json(const SessionStatus& status) {
  json list = json::array();
  for (const SessionDevice& d : status.devices) {
    json j = device_json(d.description);
    j["state"] = name_of(d.health.state);
    j["message"] = d.health.message;
    j["received"] = d.health.received;
    j["rejected"] = d.health.rejected;
    j["missing"] = d.health.missing;
    j["reconnects"] = d.health.reconnects;
    j["clock"] = clock_json(d.health.clock);
    list.push_back(std::move(j));
  }
  return text_of({{"devices", list},
                  {"elapsed_s", status.elapsed_s},
                  {"queue_peak_bytes", status.queue_peak_bytes},
                  {"longest_sync_s", status.longest_sync_s},
                  {"longest_write_s", status.longest_write_s}});
}

}  // namespace gnathion
