// HID reports of foot pedals: bytes in, pressed keys out. No I/O, no clock.
//
// Pedals show themselves as keyboards, mice or sets of buttons; what a report means is read from the device's
// report descriptor (USB HID 1.11, sections 5 and 6.2.2).
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "core/result.h"
#include "core/time.h"

namespace gnathion {

/// Usage page and usage of a key or button: 0x00070004 is the keyboard's "a", 0x00090001 button 1.
using HidUsage = std::uint32_t;

/// One input item of a report: `count` fields of `bits` bits each.
struct HidField {
  int report_id = 0;  ///< 0: reports have no number
  std::size_t first_bit = 0, bits = 0, count = 0;
  bool array = false;  ///< each field holds an index of what is pressed; otherwise one bit a usage
  std::int64_t logical_min = 0, logical_max = 0;
  std::vector<HidUsage> usages;  ///< as listed; empty where a range is given
  HidUsage usage_min = 0, usage_max = 0;
};

/// The keys and buttons of a device's input reports.
class HidLayout {
 public:
  /// Refuses descriptors that end inside an item, nest wrongly, claim reports beyond 4096 bytes, or have
  /// neither keys nor buttons.
  static Result<HidLayout> parse(std::string_view report_descriptor, const std::string& where);

  /// What is pressed, by the reports so far: a report replaces what an earlier one of its number said.
  /// An unknown number or a report shorter than its fields is refused.
  tl::expected<std::set<HidUsage>, std::string> pressed(int report_id, std::string_view fields) const;
  bool numbered() const { return numbered_; }
  const std::vector<HidField>& fields() const { return fields_; }

 private:
  std::vector<HidField> fields_;  ///< of keyboards, buttons and consumer controls
  std::map<int, std::size_t> report_bits_;
  bool numbered_ = false;
};

/// Keys by name: "a"…"z", "0"…"9", "f1"…"f24", "enter", "esc", "space", "tab", "button1"…,
/// "usage:0x00070004".
std::optional<HidUsage> usage_named(const std::string& name);
std::string name_of_usage(HidUsage usage);

/// The state of all keys from report to report.
class PedalDecoder {
 public:
  explicit PedalDecoder(HidLayout layout) : layout_(std::move(layout)) {}
  struct Edge {
    HidUsage usage = 0;
    bool pressed = false;
  };
  /// Keys that changed with this report; the error says what is wrong with it.
  tl::expected<std::vector<Edge>, std::string> take(std::string_view report);
  /// What is held down.
  std::set<HidUsage> held() const;

 private:
  HidLayout layout_;
  std::map<int, std::set<HidUsage>> pressed_;  ///< by report number
};

/// One pedal's contact, freed of bounce: the first edge counts and is told at once; what follows within
/// `window_ns` is bounce, unless the contact has another state when the window ends: then that state is
/// told with the time of its own edge.
class Debouncer {
 public:
  explicit Debouncer(std::int64_t window_ns) : window_ns_(window_ns) {}
  struct Change {
    bool pressed = false;
    HostTime when;
  };
  std::optional<Change> edge(bool pressed, HostTime when);
  /// What the end of the window brings; call before each edge and when time has passed.
  std::optional<Change> passed(HostTime now);
  bool pressed() const { return told_; }

 private:
  /// Not when the clock was set back: a window must not last for as long as that.
  bool in_window(HostTime now) const;

  std::int64_t window_ns_;
  bool told_ = false, contact_ = false;
  std::optional<HostTime> window_start_;
  HostTime contact_since_;
};

}  // namespace gnathion
