#include "acquisition/usb/pedal_protocol.h"

#include <fmt/format.h>

#include <algorithm>

namespace gnathion {
namespace {

constexpr std::size_t kMaxReportBits = 8 * 4096;  // what hidraw hands out at most
constexpr std::size_t kMaxFields = 256, kMaxUsages = 4096, kMaxPushes = 16;
constexpr std::uint32_t kKeyboardPage = 0x07, kButtonPage = 0x09, kConsumerPage = 0x0c;
constexpr HidUsage kLastKeyboardError = 0x00070003;  // 1…3: rollover, POST fail, undefined

bool is_pedal_page(HidUsage usage) {
  const std::uint32_t page = usage >> 16;
  return page == kKeyboardPage || page == kButtonPage || page == kConsumerPage;
}
bool is_key(HidUsage usage) {
  return is_pedal_page(usage) && (usage & 0xffff) != 0 &&
         !(usage >> 16 == kKeyboardPage && usage <= kLastKeyboardError);
}

/// The value of a short item: little-endian, 0, 1, 2 or 4 bytes.
std::uint32_t unsigned_value(std::string_view data) {
  std::uint32_t v = 0;
  for (std::size_t i = data.size(); i-- > 0;) v = (v << 8) | static_cast<unsigned char>(data[i]);
  return v;
}
std::int64_t signed_value(std::string_view data) {
  const std::uint32_t v = unsigned_value(data);
  if (data.size() == 1) return static_cast<std::int8_t>(v);
  if (data.size() == 2) return static_cast<std::int16_t>(v);
  return data.size() == 4 ? static_cast<std::int32_t>(v) : 0;
}

/// The item state table (HID 1.11, 5.4 and 6.2.2): global items stay, local ones go with each main item.
class Parser {
 public:
  std::optional<std::string> parse(std::string_view descriptor);
  std::vector<HidField> fields;
  std::map<int, std::size_t> bits;
  bool numbered = false;

 private:
  struct Globals {
    std::uint32_t page = 0;
    std::int64_t logical_min = 0, logical_max = 0;
    std::size_t size = 0, count = 0;
    int report_id = 0;
  };
  std::optional<std::string> main_item(int tag, std::uint32_t value);
  std::optional<std::string> global_item(int tag, std::string_view data);
  void local_item(int tag, std::string_view data);
  std::optional<std::string> input(std::uint32_t flags);
  HidUsage with_page(std::string_view data) const {
    return data.size() == 4 ? unsigned_value(data) : (globals_.page << 16) | unsigned_value(data);
  }

  Globals globals_;
  std::vector<Globals> stack_;
  std::vector<HidUsage> usages_;
  HidUsage usage_min_ = 0, usage_max_ = 0;
  int depth_ = 0;
};

std::optional<std::string> Parser::parse(std::string_view d) {
  for (std::size_t at = 0; at < d.size();) {
    const auto prefix = static_cast<unsigned char>(d[at]);
    if (prefix == 0xfe) {  // a long item: none is defined
      if (at + 2 >= d.size()) return fmt::format("ends inside an item at byte {}", at);
      at += 3 + static_cast<unsigned char>(d[at + 1]);
      if (at > d.size()) return "ends inside a long item";
      continue;
    }
    const std::size_t size = (prefix & 3) == 3 ? 4 : prefix & 3;
    if (at + 1 + size > d.size()) return fmt::format("ends inside an item at byte {}", at);
    const std::string_view data = d.substr(at + 1, size);
    const int type = (prefix >> 2) & 3, tag = prefix >> 4;
    std::optional<std::string> wrong;
    if (type == 0) {
      wrong = main_item(tag, unsigned_value(data));
      usages_.clear();
      usage_min_ = usage_max_ = 0;
    } else if (type == 1) {
      wrong = global_item(tag, data);
    } else if (type == 2) {
      local_item(tag, data);
    }
    if (wrong) return *wrong + fmt::format(" at byte {}", at);
    at += 1 + size;
  }
  if (depth_ != 0) return "leaves a collection open";
  return std::nullopt;
}

std::optional<std::string> Parser::main_item(int tag, std::uint32_t value) {
  if (tag == 0x8) return input(value);
  if (tag == 0xa) ++depth_;
  if (tag == 0xc && --depth_ < 0) return "closes a collection that was not open";
  return std::nullopt;
}

std::optional<std::string> Parser::global_item(int tag, std::string_view data) {
  switch (tag) {
    case 0x0:
      globals_.page = unsigned_value(data) & 0xffff;
      break;
    case 0x1:
      globals_.logical_min = signed_value(data);
      break;
    case 0x2:  // "25 ff" is meant as 255 where the minimum is not negative
      globals_.logical_max = globals_.logical_min < 0 ? signed_value(data) : unsigned_value(data);
      break;
    case 0x7:
      globals_.size = unsigned_value(data);
      if (globals_.size > 32) return fmt::format("has fields of {} bits", globals_.size);
      break;
    case 0x8:
      if (unsigned_value(data) == 0 || unsigned_value(data) > 255) return "has an impossible report number";
      globals_.report_id = static_cast<int>(unsigned_value(data));
      numbered = true;
      break;
    case 0x9:
      globals_.count = unsigned_value(data);
      if (globals_.count > kMaxReportBits) return fmt::format("claims {} fields", globals_.count);
      break;
    case 0xa:
      if (stack_.size() >= kMaxPushes) return "pushes too deep";
      stack_.push_back(globals_);
      break;
    case 0xb:
      if (stack_.empty()) return "pops what was not pushed";
      globals_ = stack_.back();
      stack_.pop_back();
      break;
    default:
      break;
  }
  return std::nullopt;
}

void Parser::local_item(int tag, std::string_view data) {
  if (tag == 0x0 && usages_.size() < kMaxUsages) usages_.push_back(with_page(data));
  if (tag == 0x1) usage_min_ = with_page(data);
  if (tag == 0x2) usage_max_ = with_page(data);
}

std::optional<std::string> Parser::input(std::uint32_t flags) {
  std::size_t& used = bits[globals_.report_id];
  const std::size_t first = used;
  used += globals_.size * globals_.count;
  if (used > kMaxReportBits) return "claims reports beyond 4096 bytes";
  const bool constant = flags & 1, array = !(flags & 2);
  if (constant || globals_.size == 0 || globals_.count == 0) return std::nullopt;
  HidField field{globals_.report_id,   first,   globals_.size, globals_.count, array, globals_.logical_min,
                 globals_.logical_max, usages_, usage_min_,    usage_max_};
  if (!field.usages.empty()) field.usage_min = field.usage_max = 0;
  const HidUsage first_usage = field.usages.empty() ? field.usage_min : field.usages.front();
  if (!is_pedal_page(first_usage) || fields.size() >= kMaxFields) return std::nullopt;
  fields.push_back(std::move(field));
  return std::nullopt;
}

/// Bits come lowest first, across bytes (HID 1.11, 5.8 note).
std::uint32_t bits_at(std::string_view bytes, std::size_t first, std::size_t count) {
  std::uint32_t v = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t bit = first + i;
    v |= std::uint32_t{(static_cast<unsigned char>(bytes[bit / 8]) >> (bit % 8)) & 1u} << i;
  }
  return v;
}

HidUsage usage_at(const HidField& field, std::size_t index) {
  if (!field.usages.empty()) return field.usages[std::min(index, field.usages.size() - 1)];
  const std::uint64_t usage = std::uint64_t{field.usage_min} + index;
  return usage <= field.usage_max ? static_cast<HidUsage>(usage) : 0;
}

void press(const HidField& field, std::string_view bytes, std::set<HidUsage>& pressed) {
  for (std::size_t i = 0; i < field.count; ++i) {
    const std::uint32_t value = bits_at(bytes, field.first_bit + i * field.bits, field.bits);
    HidUsage usage = 0;
    if (!field.array) {
      if (value != 0) usage = usage_at(field, i);
    } else if (value >= field.logical_min && value <= field.logical_max) {
      usage = usage_at(field, static_cast<std::size_t>(value - field.logical_min));
    }
    if (is_key(usage)) pressed.insert(usage);
  }
}

}  // namespace

Result<HidLayout> HidLayout::parse(std::string_view report_descriptor, const std::string& where) {
  Parser parser;
  const std::optional<std::string> wrong = parser.parse(report_descriptor);
  constexpr const char* what = "cannot use report descriptor";
  if (wrong) return bad_input(what, where, "it " + *wrong);
  if (parser.fields.empty()) return bad_input(what, where, "it has neither keys nor buttons");
  HidLayout layout;
  layout.fields_ = std::move(parser.fields);
  layout.report_bits_ = std::move(parser.bits);
  layout.numbered_ = parser.numbered;
  return layout;
}

tl::expected<std::set<HidUsage>, std::string> HidLayout::pressed(int report_id,
                                                                 std::string_view bytes) const {
  const auto known = report_bits_.find(report_id);
  if (known == report_bits_.end()) return tl::unexpected(fmt::format("unknown report {}", report_id));
  const std::size_t needed = (known->second + 7) / 8;
  if (bytes.size() < needed)
    return tl::unexpected(fmt::format("short report: {} of {} bytes", bytes.size(), needed));
  std::set<HidUsage> result;
  for (const HidField& field : fields_)
    if (field.report_id == report_id) press(field, bytes, result);
  return result;
}

tl::expected<std::vector<PedalDecoder::Edge>, std::string> PedalDecoder::take(std::string_view report) {
  if (report.empty()) return tl::unexpected(std::string("empty report"));
  const int id = layout_.numbered() ? static_cast<unsigned char>(report.front()) : 0;
  auto now = layout_.pressed(id, layout_.numbered() ? report.substr(1) : report);
  if (!now) return tl::unexpected(now.error());
  const std::set<HidUsage> before = held();
  pressed_[id] = std::move(*now);
  const std::set<HidUsage> after = held();
  std::vector<Edge> edges;
  for (const HidUsage usage : before)
    if (!after.count(usage)) edges.push_back({usage, false});
  for (const HidUsage usage : after)
    if (!before.count(usage)) edges.push_back({usage, true});
  return edges;
}

std::set<HidUsage> PedalDecoder::held() const {
  std::set<HidUsage> all;
  for (const auto& [id, pressed] : pressed_) all.insert(pressed.begin(), pressed.end());
  return all;
}

std::optional<HidUsage> usage_named(const std::string& name) {
  const auto number = [&](std::size_t from, int base) -> std::optional<std::uint32_t> {
    std::size_t used = 0;
    if (from >= name.size() || !std::isxdigit(static_cast<unsigned char>(name[from]))) return std::nullopt;
    try {
      const unsigned long v = std::stoul(name.substr(from), &used, base);
      if (from + used != name.size() || v > 0xffffffffUL) return std::nullopt;
      return static_cast<std::uint32_t>(v);
    } catch (const std::exception&) {
      return std::nullopt;
    }
  };
  constexpr HidUsage kKeys = kKeyboardPage << 16;
  if (name.size() == 1 && name[0] >= 'a' && name[0] <= 'z') return kKeys | (0x04u + (name[0] - 'a'));
  if (name.size() == 1 && name[0] >= '1' && name[0] <= '9') return kKeys | (0x1eu + (name[0] - '1'));
  if (name == "0") return kKeys | 0x27u;
  static const std::map<std::string, HidUsage> named = {
      {"enter", 0x28}, {"esc", 0x29}, {"tab", 0x2b}, {"space", 0x2c}};
  if (const auto found = named.find(name); found != named.end()) return kKeys | found->second;
  if (name.rfind("button", 0) == 0)
    if (const auto n = number(6, 10); n && *n >= 1 && *n <= 0xffff) return (kButtonPage << 16) | *n;
  if (name.rfind("usage:0x", 0) == 0) return number(8, 16);
  if (name.size() >= 2 && name[0] == 'f')
    if (const auto n = number(1, 10); n && *n >= 1 && *n <= 24)
      return kKeys | (*n <= 12 ? 0x3au + (*n - 1) : 0x68u + (*n - 13));
  return std::nullopt;
}

std::string name_of_usage(HidUsage usage) {
  const std::uint32_t id = usage & 0xffff;
  if (usage >> 16 == kButtonPage) return fmt::format("button{}", id);
  if (usage >> 16 == kKeyboardPage) {
    if (id >= 0x04 && id <= 0x1d) return std::string(1, static_cast<char>('a' + (id - 0x04)));
    if (id >= 0x1e && id <= 0x26) return std::string(1, static_cast<char>('1' + (id - 0x1e)));
    if (id == 0x27) return "0";
    if (id >= 0x3a && id <= 0x45) return fmt::format("f{}", id - 0x3a + 1);
    if (id >= 0x68 && id <= 0x73) return fmt::format("f{}", id - 0x68 + 13);
    static const std::map<HidUsage, const char*> named = {
        {0x28, "enter"}, {0x29, "esc"}, {0x2b, "tab"}, {0x2c, "space"}};
    if (const auto found = named.find(id); found != named.end()) return found->second;
  }
  return fmt::format("usage:0x{:08x}", usage);
}

bool Debouncer::in_window(HostTime now) const {
  return window_start_ && now >= *window_start_ && now.ns - window_start_->ns < window_ns_;
}

std::optional<Debouncer::Change> Debouncer::edge(bool pressed, HostTime when) {
  if (pressed == contact_) return std::nullopt;
  contact_ = pressed;
  contact_since_ = when;
  if (in_window(when)) return std::nullopt;
  window_start_ = when;
  told_ = pressed;
  return Change{pressed, when};
}

std::optional<Debouncer::Change> Debouncer::passed(HostTime now) {
  if (!window_start_ || in_window(now)) return std::nullopt;
  window_start_.reset();
  if (contact_ == told_) return std::nullopt;
  told_ = contact_;
  window_start_ = contact_since_;
  return Change{told_, contact_since_};
}

}  // namespace gnathion
