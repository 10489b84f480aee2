#include "acquisition/usb/pedal_device.h"

#include <fmt/format.h>

#include <array>
#include <limits>
#include <map>

#include "acquisition/recording.h"
#include "acquisition/usb/hid_transport.h"
#include "acquisition/usb/pedal_protocol.h"
#include "acquisition/usb/transfer_device.h"

namespace gnathion {
namespace {

constexpr HidProduct kInfinity[] = {{0x05f3, 0x00ff, "Infinity IN-USB-2"}};
constexpr HidProduct kPcsensor[] = {{0x3553, 0xb001, "PCsensor FootSwitch"},
                                    {0x0c45, 0x7403, "PCsensor FootSwitch"},
                                    {0x1a86, 0xe026, "PCsensor FootSwitch"}};
constexpr const char* kNames[] = {"left", "middle", "right"};
constexpr const char* kMarks[] = {"MI", "TP", "note"};  // unless the configuration says otherwise
constexpr const char* kButtons[] = {"button1", "button2", "button3"};  // of the Infinity
constexpr const char* kKeys[] = {"a", "b", "c"};                       // a PCsensor as it is delivered

struct Pedal {
  std::string name, mark;
  std::vector<HidUsage> usages;
};

struct PedalSettings {
  std::array<Pedal, 3> pedals;
  std::int64_t debounce_ns = 0;
};

class PedalSession : public TransferSession {
 public:
  PedalSession(std::string stream, std::string where, PedalSettings settings)
      : TransferSession(std::move(stream)), where_(std::move(where)), settings_(std::move(settings)) {
    for (const Pedal& pedal : settings_.pedals)
      contacts_.push_back({&pedal, Debouncer(settings_.debounce_ns), {}});
  }

 protected:
  void opened(const TransferSample& descriptors, std::deque<Sample>& out) override;
  void received(const TransferSample& transfer, std::deque<Sample>& out) override;
  void lost(const TransferSample& transfer, std::deque<Sample>& out) override;
  void passed(HostTime now, std::deque<Sample>& out) override;
  void ended(std::deque<Sample>& out) override;

 private:
  struct Contact {
    const Pedal* pedal;
    Debouncer debouncer;
    std::set<HidUsage> held;
  };
  Contact* contact_of(HidUsage usage);
  void mark(const Contact& contact, const Debouncer::Change& change, const std::string& why,
            std::deque<Sample>& out);

  std::string where_;
  const PedalSettings settings_;
  std::optional<PedalDecoder> decoder_;
  std::vector<Contact> contacts_;
  std::uint32_t marks_ = 0;
};

void PedalSession::opened(const TransferSample& descriptors, std::deque<Sample>& out) {
  tell_working(descriptors.header.arrival, out);
  decoder_.reset();
  auto layout = HidLayout::parse(descriptors.data, where_);
  if (layout)
    decoder_.emplace(std::move(*layout));
  else
    out.emplace_back(rejected(raw_stream(), descriptors.header, layout.error().line()));
}

PedalSession::Contact* PedalSession::contact_of(HidUsage usage) {
  for (Contact& contact : contacts_)
    for (const HidUsage own : contact.pedal->usages)
      if (own == usage) return &contact;
  return nullptr;
}

void PedalSession::received(const TransferSample& transfer, std::deque<Sample>& out) {
  if (!decoder_) return;
  const auto edges = decoder_->take(transfer.data);
  if (!edges) return out.emplace_back(rejected(stream(), transfer.header, edges.error())), void();
  for (const PedalDecoder::Edge& edge : *edges) {
    Contact* contact = contact_of(edge.usage);
    if (!contact) {
      if (edge.pressed)
        out.emplace_back(
            rejected(stream(), transfer.header, "no pedal has the key " + name_of_usage(edge.usage)));
      continue;
    }
    if (edge.pressed)
      contact->held.insert(edge.usage);
    else
      contact->held.erase(edge.usage);
    if (const auto change = contact->debouncer.edge(!contact->held.empty(), transfer.header.arrival))
      mark(*contact, *change, {}, out);
  }
}

void PedalSession::mark(const Contact& contact, const Debouncer::Change& change, const std::string& why,
                        std::deque<Sample>& out) {
  if (contact.pedal->mark == "none") return;
  EventSample event;
  event.header.stream = stream();
  event.header.sequence = marks_++;
  event.header.capture = event.header.arrival = change.when;
  event.kind = contact.pedal->mark;
  event.pressed = change.pressed;
  event.text = contact.pedal->name + (why.empty() ? "" : ": " + why);
  out.emplace_back(std::move(event));
}

void PedalSession::passed(HostTime now, std::deque<Sample>& out) {
  for (Contact& contact : contacts_)
    while (const auto change = contact.debouncer.passed(now)) mark(contact, *change, {}, out);
}

/// A pedal that goes away while it is held down is released: a mark must not stay open.
void PedalSession::lost(const TransferSample& transfer, std::deque<Sample>& out) {
  for (Contact& contact : contacts_) {
    if (contact.debouncer.pressed()) mark(contact, {false, transfer.header.arrival}, "device gone", out);
    contact.debouncer = Debouncer(settings_.debounce_ns);
    contact.held.clear();
  }
  decoder_.reset();
}

void PedalSession::ended(std::deque<Sample>& out) {
  passed({std::numeric_limits<std::int64_t>::max()}, out);
}

struct PedalConfig {
  std::vector<HidProduct> products;
  InstrumentChoice choice;
  PedalSettings settings;
  bool wait = false;
  std::optional<std::filesystem::path> replay;
  DeviceDescription description;
};

std::optional<HidProduct> product_from(const std::string& id) {
  unsigned vendor = 0, product = 0;
  int used = 0;
  if (std::sscanf(id.c_str(), "%4x:%4x%n", &vendor, &product, &used) != 2 ||
      used != static_cast<int>(id.size()))
    return std::nullopt;
  return HidProduct{static_cast<std::uint16_t>(vendor), static_cast<std::uint16_t>(product), "foot pedal"};
}

void read_products(SettingsReader& reader, PedalConfig& config) {
  const std::string product = reader.choice("product", {"any", "infinity", "pcsensor"}, "any");
  const auto id = reader.text("usb_id");
  if (id) {
    const auto other = product_from(*id);
    if (other)
      config.products = {*other};
    else
      reader.refuse("usb_id", "must be vendor:product in hexadecimal: \"05f3:00ff\"");
    return;
  }
  if (product != "pcsensor")
    config.products.insert(config.products.end(), std::begin(kInfinity), std::end(kInfinity));
  if (product != "infinity")
    config.products.insert(config.products.end(), std::begin(kPcsensor), std::end(kPcsensor));
}

void read_pedals(SettingsReader& reader, PedalConfig& config) {
  std::map<HidUsage, std::string> taken;
  for (std::size_t i = 0; i < config.settings.pedals.size(); ++i) {
    Pedal& pedal = config.settings.pedals[i];
    pedal.name = kNames[i];
    pedal.mark = reader.choice(pedal.name, {"MI", "TP", "note", "none"}, kMarks[i]);
    const std::string key = pedal.name + "_key";
    const auto named = reader.text(key);
    const std::vector<std::string> keys =
        named ? std::vector<std::string>{*named} : std::vector<std::string>{kButtons[i], kKeys[i]};
    for (const std::string& k : keys) {
      const auto usage = usage_named(k);
      if (!usage)
        reader.refuse(
            key, fmt::format("names no key: '{}'; it is one of a…z, 0…9, f1…f24, enter, esc, space, tab, "
                             "button1…, usage:0x00070004",
                             k));
      else if (const auto [other, fresh] = taken.emplace(*usage, pedal.name); !fresh && named)
        reader.refuse(key, fmt::format("is '{}', which is the {} pedal's", k, other->second));
      else if (fresh)
        pedal.usages.push_back(*usage);
    }
    config.description.settings.push_back(
        fmt::format("{}: {} (keys {})", pedal.name, pedal.mark, fmt::join(keys, ", ")));
  }
}

Result<PedalConfig> read_config(const DeviceConfig& from) {
  SettingsReader reader(from);
  PedalConfig config;
  read_products(reader, config);
  config.choice = {reader.text("serial"), reader.text("port"), std::nullopt};
  if (const auto number = reader.integer("interface")) config.choice.interface = static_cast<int>(*number);
  read_pedals(reader, config);
  const double debounce_ms = reader.number_in("debounce_ms", 0, 500, 30);
  config.settings.debounce_ns = static_cast<std::int64_t>(debounce_ms * 1e6);
  config.wait = reader.flag("wait").value_or(false);
  config.replay = reader.path("replay");
  GNATHION_CHECK_OK(reader.finish());
  config.description.kind = from.kind;
  config.description.stream = from.stream;
  config.description.settings.push_back(fmt::format("debounce_ms: {:g}", debounce_ms));
  return config;
}

std::unique_ptr<PedalSession> session_of(const DeviceConfig& from, const PedalConfig& config) {
  return std::make_unique<PedalSession>(from.stream, from.where, config.settings);
}

}  // namespace

Result<std::unique_ptr<Device>> open_pedal(const DeviceConfig& from, Clock& clock) {
  GNATHION_TRY(PedalConfig config, read_config(from));
  if (config.replay) {
    GNATHION_TRY(std::unique_ptr<Source> recording, RecordingSource::open(*config.replay));
    return replay_pedal(from, std::move(recording));
  }
  const auto fits = [where = from.where](const std::string& descriptor) -> Status {
    GNATHION_TRY([[maybe_unused]] const HidLayout layout, HidLayout::parse(descriptor, where));
    return {};
  };
  auto finder = find_hid(config.products, config.choice, fits, "foot pedal", from.where, clock);
  GNATHION_TRY(auto device, TransferDevice::open(config.description, std::move(finder),
                                                 session_of(from, config), config.wait, clock));
  return device;
}

Result<std::unique_ptr<Device>> replay_pedal(const DeviceConfig& from, std::unique_ptr<Source> recording) {
  GNATHION_TRY(PedalConfig config, read_config(from));
  return std::make_unique<TransferReplay>(config.description, std::move(recording), session_of(from, config));
}

}  // namespace gnathion
