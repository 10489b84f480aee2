// Foot pedals through the real hidapi, alone and beside a tracker.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>

#include "acquisition/usb/pedal_device.h"
#include "acquisition/usb/polhemus_device.h"
#include "core/file.h"
#include "core/random.h"
#include "tests/support/mock_tracker.h"
#include "tests/support/pedal_reports.h"
#include "tests/support/pull.h"

namespace gnathion {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

mock::Bed& bed() {
  static mock::Bed the_bed;
  return the_bed;
}

DeviceConfig configured(std::map<std::string, ConfigValue> settings = {}) {
  settings.emplace("debounce_ms", std::int64_t{0});  // unless the test is about it
  return {"pedal", "pedal", std::move(settings), "devices.toml: pedal", {}};
}

mock::HidSpec infinity() {
  mock::HidSpec spec;
  spec.report_descriptor = infinity_descriptor();
  return spec;
}
mock::HidSpec pcsensor(std::uint16_t vendor, std::uint16_t product) {
  mock::HidSpec spec;
  spec.vendor = vendor;
  spec.product = product;
  spec.name = "PCsensor FootSwitch";
  spec.report_descriptor = keyboard_descriptor();
  return spec;
}

std::function<bool(const EventSample&)> mark(const std::string& kind, bool pressed) {
  return [=](const EventSample& e) {
    return e.header.stream == "pedal" && e.kind == kind && e.pressed == pressed;
  };
}
std::function<bool(const EventSample&)> state(bool back) {
  return [back](const EventSample& e) { return e.header.stream == "pedal/state" && e.pressed == back; };
}
/// "+MI left" for a press, in the order of delivery.
std::vector<std::string> marks(const std::vector<Sample>& samples) {
  std::vector<std::string> all;
  for (const EventSample& e : Pull::all<EventSample>(samples))
    if (e.header.stream == "pedal") all.push_back((e.pressed ? "+" : "-") + e.kind + " " + e.text);
  return all;
}
std::vector<std::string> reasons(const std::vector<Sample>& samples) {
  std::vector<std::string> all;
  for (const LedgerSample& l : Pull::all<LedgerSample>(samples)) all.push_back(l.reason);
  return all;
}

class PedalTest : public ::testing::Test {
 protected:
  void open(std::map<std::string, ConfigValue> settings = {}) {
    auto opened = open_pedal(configured(std::move(settings)), clock_);
    ASSERT_TRUE(opened) << opened.error().line();
    device_ = std::move(*opened);
    pull_ = std::make_unique<Pull>(*device_);
  }
  void TearDown() override {
    pull_.reset();
    device_.reset();
  }
  std::string refusal(std::map<std::string, ConfigValue> settings = {}) {
    const auto opened = open_pedal(configured(std::move(settings)), clock_);
    return opened ? "opened" : opened.error().line();
  }
  bool event_came(const std::function<bool(const EventSample&)>& is, std::size_t n = 1) {
    return pull_->wait([&](const Pull::Samples& s) { return Pull::count<EventSample>(s, is) >= n; });
  }

  SystemClock clock_;
  mock::Hid infinity_{bed(), infinity()};
  std::unique_ptr<Device> device_;
  std::unique_ptr<Pull> pull_;
};

TEST_F(PedalTest, MarksHaveTheirPressesAndReleases) {
  infinity_.plug();
  open();
  infinity_.push(infinity_report(true, false, false));
  infinity_.push(infinity_report(true, false, false));  // a report sent twice says nothing new
  infinity_.push(infinity_report(false, true, false));
  infinity_.push(infinity_report(false, false, true));
  infinity_.push(infinity_report(false, false, false));
  ASSERT_TRUE(event_came(mark("note", false)));
  const auto samples = pull_->stop();
  EXPECT_THAT(marks(samples),
              ElementsAre("+MI left", "-MI left", "+TP middle", "-TP middle", "+note right", "-note right"));
  EXPECT_THAT(reasons(samples), IsEmpty());
  EXPECT_EQ(Pull::all<TransferSample>(samples).size(), 6u);  // the report descriptor and five reports
  EXPECT_EQ(device_->description().vendor, "Maker");
  EXPECT_EQ(device_->description().model, "Infinity IN-USB-2");
}

TEST_F(PedalTest, MappingIsConfigurable) {
  infinity_.plug();
  open({{"left", std::string("note")},
        {"middle", std::string("none")},
        {"right", std::string("MI")},
        {"right_key", std::string("button1")},
        {"left_key", std::string("button3")}});
  infinity_.push(infinity_report(true, false, false));
  infinity_.push(infinity_report(false, true, false));
  infinity_.push(infinity_report(false, false, true));
  infinity_.push(infinity_report(false, false, false));
  ASSERT_TRUE(event_came(mark("note", false)));
  EXPECT_THAT(marks(pull_->stop()), ElementsAre("+MI right", "-MI right", "+note left", "-note left"));
}

TEST_F(PedalTest, EveryPcsensorIsKnown) {
  for (const auto& [vendor, product] : {std::pair{0x3553, 0xb001}, {0x0c45, 0x7403}, {0x1a86, 0xe026}}) {
    mock::Hid pedal(bed(), pcsensor(static_cast<std::uint16_t>(vendor), static_cast<std::uint16_t>(product)));
    pedal.plug();
    open({{"product", std::string("pcsensor")}});
    pedal.push(keyboard_report("\x04"));
    pedal.push(keyboard_report("\x05"));
    pedal.push(keyboard_report("\x06"));
    pedal.push(keyboard_report(""));
    ASSERT_TRUE(event_came(mark("note", false)));
    EXPECT_THAT(marks(pull_->stop()), ElementsAre("+MI left", "-MI left", "+TP middle", "-TP middle",
                                                  "+note right", "-note right"));
    TearDown();
  }
}

TEST_F(PedalTest, BounceIsLeftOutAndTimesAreThoseOfTheEdges) {
  infinity_.plug();
  open({{"debounce_ms", std::int64_t{400}}});
  infinity_.push(infinity_report(true, false, false));
  infinity_.push(infinity_report(false, false, false));
  infinity_.push(infinity_report(true, false, false));
  infinity_.push(infinity_report(false, false, false));  // a tap shorter than the window
  ASSERT_TRUE(event_came(mark("MI", false)));
  const auto samples = pull_->stop();
  EXPECT_THAT(marks(samples), ElementsAre("+MI left", "-MI left"));
  const auto transfers = Pull::all<TransferSample>(samples);
  const auto events = Pull::all<EventSample>(samples);
  EXPECT_EQ(events[0].header.capture, transfers[1].header.arrival);  // the first edge
  EXPECT_EQ(events[1].header.capture, transfers[4].header.arrival);  // the last
}

TEST_F(PedalTest, ComesBackFromAHundredReplugs) {
  infinity_.plug();
  open();
  for (std::size_t i = 1; i <= 100; ++i) {
    infinity_.push(infinity_report(true, false, false));
    ASSERT_TRUE(event_came(mark("MI", true), i)) << i;
    infinity_.unplug();  // while it is held down
    ASSERT_TRUE(event_came(state(false), i)) << i;
    infinity_.plug();
    ASSERT_TRUE(event_came(state(true), i)) << i << ": " << device_->health().message;
  }
  const auto samples = pull_->stop();
  EXPECT_EQ(device_->health().reconnects, 100u);
  EXPECT_EQ(Pull::count<EventSample>(samples, mark("MI", false)), 100u);  // released by being unplugged
  EXPECT_EQ(marks(samples)[1], "-MI left: device gone");
  EXPECT_THAT(reasons(samples), IsEmpty());
}

TEST_F(PedalTest, ErrorsAndGarbageAreToldAndPassedOver) {
  infinity_.plug();
  open();
  infinity_.push(infinity_report(true, false, false));
  infinity_.push("", -EPIPE);
  infinity_.push("", -EPROTO);
  infinity_.push("", -EOVERFLOW);
  infinity_.push("", -ETIMEDOUT);
  infinity_.push(std::string(1, '\x02'));   // short
  infinity_.push(std::string(64, '\xff'));  // long: buttons 1 to 3 down, the rest is padding
  infinity_.push(infinity_report(false, false, false));
  ASSERT_TRUE(event_came(mark("note", false)));
  const auto samples = pull_->stop();
  EXPECT_THAT(marks(samples),
              ElementsAre("+MI left", "+TP middle", "+note right", "-MI left", "-TP middle", "-note right"));
  EXPECT_THAT(reasons(samples),
              ElementsAre("stall", "i/o error", "babble", "timeout", "short report: 1 of 2 bytes"));
}

TEST_F(PedalTest, APedalThatOnlyFailsIsOpenedAnew) {
  infinity_.plug();
  open();
  for (int i = 0; i < 16; ++i) infinity_.push("", -EPROTO);
  ASSERT_TRUE(event_came(state(true)));
  infinity_.push(infinity_report(false, true, false));
  ASSERT_TRUE(event_came(mark("TP", true)));
}

TEST_F(PedalTest, KeysThatNoPedalHasAreAccountedFor) {
  mock::Hid pedal(bed(), pcsensor(0x0c45, 0x7403));
  pedal.plug();
  open();
  pedal.push(keyboard_report("\x1d"));
  pedal.push(keyboard_report("\x05"));
  ASSERT_TRUE(event_came(mark("TP", true)));
  EXPECT_THAT(reasons(pull_->stop()), ElementsAre("no pedal has the key z"));
  TearDown();
}

TEST_F(PedalTest, RawReportsReplayBitForBit) {
  infinity_.plug();
  open({{"debounce_ms", std::int64_t{40}}});
  Random random(5);
  for (std::size_t i = 1; i <= 3; ++i) {
    for (int k = 0; k < 60; ++k) {
      if (random.below(10) == 0) infinity_.push("", -EPROTO);
      infinity_.push(infinity_report(random.below(2), random.below(2), random.below(2)));
      if (random.below(8) == 0) {
        ASSERT_TRUE(infinity_.drained());
      }
    }
    infinity_.push(infinity_report(true, false, false));
    ASSERT_TRUE(infinity_.drained());
    infinity_.unplug();
    ASSERT_TRUE(event_came(state(false), i));
    infinity_.plug();
    ASSERT_TRUE(event_came(state(true), i));
  }
  const auto live = pull_->stop();
  EXPECT_GE(marks(live).size(), 6u);
  std::vector<Sample> raw;
  for (const Sample& s : live)
    if (std::holds_alternative<TransferSample>(s)) raw.push_back(s);
  auto replay =
      replay_pedal(configured({{"debounce_ms", std::int64_t{40}}}), std::make_unique<VectorSource>(raw));
  ASSERT_TRUE(replay);
  std::vector<Sample> replayed;
  for (;;) {
    auto next = (*replay)->next();
    ASSERT_TRUE(next);
    if (!*next) break;
    replayed.push_back(std::move(**next));
  }
  expect_same_samples(live, replayed);
}

TEST_F(PedalTest, OtherStreamsGoOn) {
  mock::Tracker tracker(bed(), {});
  tracker.usb.plug();
  infinity_.plug();
  auto opened = open_polhemus({"polhemus", "bow", {}, "devices.toml: bow", {}}, clock_);
  ASSERT_TRUE(opened) << opened.error().line();
  const std::unique_ptr<Device> bow = std::move(*opened);
  Pull poses(*bow);
  const auto bow_is_back = [](const EventSample& e) { return e.header.stream == "bow/state" && e.pressed; };
  open();
  const auto any = [](const PoseSample&) { return true; };
  for (std::size_t i = 1; i <= 5; ++i) {  // the pedal comes and goes; the tracker goes on
    infinity_.unplug();
    ASSERT_TRUE(event_came(state(false), i));
    ASSERT_TRUE(poses.wait_more<PoseSample>(10, any));
    infinity_.plug();
    ASSERT_TRUE(event_came(state(true), i));
  }
  for (std::size_t i = 1; i <= 5; ++i) {  // and the other way round
    tracker.usb.push("", -EPIPE);
    tracker.usb.unplug();
    infinity_.push(infinity_report(true, false, false));
    ASSERT_TRUE(event_came(mark("MI", true), i));
    infinity_.push(infinity_report(false, false, false));
    ASSERT_TRUE(event_came(mark("MI", false), i));
    tracker.usb.plug();
    ASSERT_TRUE(poses.wait([&](const Pull::Samples& all) {
      return Pull::count<EventSample>(all, bow_is_back) == i &&
             std::holds_alternative<PoseSample>(all.back());
    }));
  }
  const auto tracked = poses.stop();
  std::vector<std::uint32_t> frames;
  for (const PoseSample& p : Pull::all<PoseSample>(tracked))
    if (p.header.stream == "bow/1") frames.push_back(p.header.sequence);
  for (std::size_t i = 1; i < frames.size(); ++i) ASSERT_EQ(frames[i], frames[i - 1] + 1);
  EXPECT_GE(frames.size(), 50u);
  EXPECT_EQ(bow->health().reconnects, 5u);
}

TEST_F(PedalTest, RefusesBadInputWithOneLine) {
  EXPECT_EQ(refusal(), "cannot open foot pedal: devices.toml: pedal: none is connected");
  EXPECT_THAT(refusal({{"debounce", std::int64_t{5}}}),
              HasSubstr("unknown key 'debounce'; 'debounce_ms' is meant?"));
  EXPECT_THAT(refusal({{"debounce_ms", std::int64_t{501}}}), HasSubstr("'debounce_ms' is 501"));
  EXPECT_THAT(refusal({{"left", std::string("mi")}}), HasSubstr("one of MI, TP, note, none"));
  EXPECT_THAT(refusal({{"left_key", std::string("B")}}), HasSubstr("'left_key' names no key: 'B'"));
  EXPECT_THAT(refusal({{"right_key", std::string("a")}}),
              HasSubstr("'right_key' is 'a', which is the left pedal's"));
  EXPECT_THAT(refusal({{"usb_id", std::string("5f3")}}), HasSubstr("'usb_id' must be vendor:product"));
  infinity_.plug();
  EXPECT_EQ(refusal(), "opened");
  EXPECT_THAT(refusal({{"product", std::string("pcsensor")}}), HasSubstr("none is connected"));
  EXPECT_THAT(refusal({{"serial", std::string("9")}}),
              HasSubstr("none with serial 9; there is Infinity IN-USB-2 at port 1-2"));
  mock::HidSpec twin = infinity();
  twin.port = "1-3";
  mock::Hid second(bed(), twin);
  second.plug();
  EXPECT_THAT(refusal(),
              HasSubstr("2 are connected: Infinity IN-USB-2 at port 1-2, Infinity IN-USB-2 at port 1-3; "
                        "say which by 'serial' or 'port'"));
  EXPECT_EQ(refusal({{"port", std::string("1-3")}}), "opened");
}

TEST_F(PedalTest, RefusesTwoWithOneSerial) {
  mock::HidSpec a = infinity(), b = infinity();
  a.serial = b.serial = "12";
  b.port = "1-3";
  mock::Hid first(bed(), a), second(bed(), b);
  first.plug();
  second.plug();
  EXPECT_THAT(refusal({{"serial", std::string("12")}}), HasSubstr("2 have one serial"));
  EXPECT_EQ(refusal({{"serial", std::string("12")}, {"port", std::string("1-2")}}), "opened");
}

TEST_F(PedalTest, RefusesDescriptorsThatLie) {
  for (const auto& [hex, why] : std::map<std::string, std::string>{
           {"05 0c 09 03 a1", "ends inside an item"},
           {"05 09 a1 01 19 01 29 03 75 01 95 03 81 02", "leaves a collection open"},
           {"05 09 19 01 29 03 75 20 96 ff 7f 81 02", "claims reports beyond 4096 bytes"},
           {"05 01 09 02 a1 01 c0", "has neither keys nor buttons"}}) {
    mock::HidSpec liar = infinity();
    liar.report_descriptor = from_hex(hex);
    mock::Hid pedal(bed(), liar);
    pedal.plug();
    EXPECT_THAT(
        refusal(),
        HasSubstr("cannot open foot pedal: cannot use report descriptor: devices.toml: pedal: it " + why));
  }
}

TEST_F(PedalTest, ReportsBeyondTheDescriptorAreNotTrusted) {
  mock::HidSpec spec = infinity();
  spec.report_descriptor =
      from_hex("05 09 a1 01 85 04 19 01 29 03 15 00 25 01 75 01 95 03 81 02 95 05 81 01 c0");
  mock::Hid pedal(bed(), spec);
  pedal.plug();
  open();
  pedal.push(from_hex("09 07"));
  pedal.push(from_hex("04"));
  pedal.push(from_hex("04 02"));
  ASSERT_TRUE(event_came(mark("TP", true)));
  EXPECT_THAT(reasons(pull_->stop()), ElementsAre("unknown report 9", "short report: 0 of 1 bytes"));
  TearDown();
}

/// 1a86:e026 has two interfaces; the second has neither keys nor buttons.
TEST_F(PedalTest, TakesTheInterfaceThatHasKeys) {
  mock::HidSpec keys = pcsensor(0x1a86, 0xe026), other = keys;
  other.interface = 1;
  other.report_descriptor = from_hex("05 01 09 00 a1 01 09 01 15 00 25 ff 95 08 75 08 81 02 09 01 91 02 c0");
  mock::Hid second(bed(), other), first(bed(), keys);
  second.plug();
  first.plug();
  open();
  first.push(keyboard_report("\x05"));
  ASSERT_TRUE(event_came(mark("TP", true)));
  TearDown();
}

TEST_F(PedalTest, NamesTheRuleWhereThereIsNoPermission) {
  namespace fs = std::filesystem;
  infinity_.plug();
  const fs::path root = bed().root();
  if (::geteuid() == 0) {  // root may open everything: be nobody for a moment
    fs::permissions(root, fs::perms::all);
    for (const auto& entry : fs::recursive_directory_iterator(root))
      if (!entry.is_symlink()) fs::permissions(entry.path(), fs::perms::all);
  }
  fs::permissions(root.string() + infinity_.node(), fs::perms::none);
  if (::getuid() == 0) {
    ASSERT_EQ(::seteuid(65534), 0);
  }
  const std::string said = refusal();
  if (::getuid() == 0) {
    ASSERT_EQ(::seteuid(0), 0);
  }
  EXPECT_THAT(said, HasSubstr("no permission for /dev/hidraw"));
  EXPECT_THAT(said, HasSubstr("install packaging/udev/70-gnathion.rules to /etc/udev/rules.d"));
}

TEST(UdevRules, NameEveryInstrument) {
  const auto rules = read_file("packaging/udev/70-gnathion.rules");
  ASSERT_TRUE(rules) << rules.error().line();
  for (const char* id : {"05f3 00ff", "3553 b001", "0c45 7403", "1a86 e026"}) {
    const std::string vendor(id, 4), product(id + 5);
    EXPECT_THAT(*rules, HasSubstr("SUBSYSTEM==\"hidraw\", ATTRS{idVendor}==\"" + vendor +
                                  "\", ATTRS{idProduct}==\"" + product + "\", MODE=\"0660\""));
  }
  EXPECT_THAT(*rules,
              HasSubstr("ATTR{idVendor}==\"0f44\", ATTR{idProduct}==\"ff20|ff12|ef20|ef12\", MODE=\"0660\""));
}

}  // namespace
}  // namespace gnathion
