#include "acquisition/usb/pedal_protocol.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "core/random.h"
#include "tests/support/pedal_reports.h"

namespace gnathion {
namespace {

using ::testing::HasSubstr;

HidLayout layout_of(const std::string& descriptor) {
  auto layout = HidLayout::parse(descriptor, "pedal");
  EXPECT_TRUE(layout) << layout.error().line();
  return *layout;
}
std::string refusal(const std::string& hex) {
  const auto layout = HidLayout::parse(from_hex(hex), "pedal");
  return layout ? "parsed" : layout.error().line();
}
std::vector<std::string> edges_of(PedalDecoder& decoder, const std::string& report) {
  const auto edges = decoder.take(report);
  if (!edges) return {edges.error()};
  std::vector<std::string> names;
  for (const auto& e : *edges) names.push_back((e.pressed ? "+" : "-") + name_of_usage(e.usage));
  return names;
}
using Names = std::vector<std::string>;

TEST(PedalProtocol, ReadsButtons) {
  PedalDecoder decoder(layout_of(infinity_descriptor()));
  EXPECT_EQ(edges_of(decoder, infinity_report(true, false, false)), Names{"+button1"});
  EXPECT_EQ(edges_of(decoder, infinity_report(true, false, false)), Names{});
  EXPECT_EQ(edges_of(decoder, infinity_report(false, true, true)),
            (Names{"-button1", "+button2", "+button3"}));
  EXPECT_EQ(edges_of(decoder, std::string(1, '\0')), Names{"short report: 1 of 2 bytes"});
  EXPECT_EQ(edges_of(decoder, ""), Names{"empty report"});
  EXPECT_EQ(decoder.held().size(), 2u);  // what is wrong changes nothing
}

TEST(PedalProtocol, ReadsBootKeyboards) {
  PedalDecoder decoder(layout_of(keyboard_descriptor()));
  EXPECT_EQ(edges_of(decoder, keyboard_report("\x04")), Names{"+a"});
  EXPECT_EQ(edges_of(decoder, keyboard_report("\x05\x04")), Names{"+b"});
  EXPECT_EQ(edges_of(decoder, keyboard_report("\x01\x01\x01\x01\x01\x01")), (Names{"-a", "-b"}));  // rollover
  EXPECT_EQ(edges_of(decoder, std::string("\x02\0\0\0\0\0\0\0", 8)), Names{"+usage:0x000700e1"});
}

TEST(PedalProtocol, ReadsTheDescriptorOfARealPcsensor) {
  const char* shared = std::getenv("GNATHION_SHARED");
  const std::string file =
      std::string(shared ? shared : "../shared") + "/data/usb/pcsensor-footswitch-1a86-e026.hid";
  std::string descriptor = line_of(file, 'R'), event = line_of(file, 'E');
  if (descriptor.empty()) GTEST_SKIP() << file << " is not here";
  descriptor = from_hex(descriptor.substr(descriptor.find(' ')));  // its first number counts the bytes
  const HidLayout layout = layout_of(descriptor);
  EXPECT_TRUE(layout.numbered());
  event = event.substr(event.find(' ') + 1);
  PedalDecoder decoder(layout);
  EXPECT_EQ(edges_of(decoder, from_hex(event.substr(event.find(' ')))), Names{"+b"});
  EXPECT_EQ(edges_of(decoder, from_hex("02 04 00 00 00")), Names{"+button3"});  // as a mouse, beside the key
  EXPECT_EQ(edges_of(decoder, from_hex("01 00 00 00 00 00 00 00 00")), Names{"-b"});
  EXPECT_EQ(edges_of(decoder, from_hex("07 00")), Names{"unknown report 7"});
}

TEST(PedalProtocol, RefusesDescriptorsThatLie) {
  EXPECT_THAT(refusal(""), HasSubstr("neither keys nor buttons"));
  EXPECT_THAT(refusal("05 0c 09 03 a1"), HasSubstr("ends inside an item at byte 4"));
  EXPECT_THAT(refusal("fe 20 00 01"), HasSubstr("ends inside a long item"));
  EXPECT_THAT(refusal("05 09 a1 01 19 01 29 03 75 01 95 03 81 02"), HasSubstr("leaves a collection open"));
  EXPECT_THAT(refusal("c0"), HasSubstr("closes a collection that was not open"));
  EXPECT_THAT(refusal("05 09 19 01 29 03 75 20 96 ff 7f 81 02"),
              HasSubstr("claims reports beyond 4096 bytes"));
  EXPECT_THAT(refusal("05 09 75 21 95 01 81 02"), HasSubstr("fields of 33 bits"));
  EXPECT_THAT(refusal("85 00"), HasSubstr("impossible report number"));
  EXPECT_THAT(refusal("b4"), HasSubstr("pops what was not pushed"));
  EXPECT_THAT(refusal("05 01 09 00 a1 01 09 01 15 00 25 ff 95 08 75 08 81 02 09 01 91 02 c0"),
              HasSubstr("neither keys nor buttons"));  // the second interface of 1a86:e026
}

TEST(PedalProtocol, NamesOfKeysLeadBackToThem) {
  for (const char* name : {"a", "z", "0", "1", "9", "f1", "f12", "f13", "f24", "enter", "esc", "tab", "space",
                           "button1", "button16", "usage:0x000700e1"}) {
    const auto usage = usage_named(name);
    ASSERT_TRUE(usage) << name;
    EXPECT_EQ(name_of_usage(*usage), name);
  }
  EXPECT_EQ(usage_named("a"), 0x00070004u);
  EXPECT_EQ(usage_named("button3"), 0x00090003u);
  for (const char* name : {"", "A", "f0", "f25", "f1x", "button", "button0", "usage:4", "usage:0x",
                           "usage:0x123456789", "f-1", "buttonx"})
    EXPECT_FALSE(usage_named(name)) << name;
}

constexpr std::int64_t kMs = 1'000'000;

TEST(Debouncer, TellsTheFirstEdgeAtOnceAndWithItsOwnTime) {
  Debouncer d(30 * kMs);
  const auto press = d.edge(true, {100 * kMs});
  ASSERT_TRUE(press);
  EXPECT_TRUE(press->pressed);
  EXPECT_EQ(press->when.ns, 100 * kMs);
  EXPECT_FALSE(d.edge(false, {103 * kMs}));  // bounce
  EXPECT_FALSE(d.edge(true, {105 * kMs}));
  EXPECT_FALSE(d.passed({130 * kMs}));
  const auto release = d.edge(false, {500 * kMs});
  ASSERT_TRUE(release);
  EXPECT_EQ(release->when.ns, 500 * kMs);
}

TEST(Debouncer, AShortTapIsReleasedWhenTheWindowEndsWithTheTimeOfItsEdge) {
  Debouncer d(30 * kMs);
  ASSERT_TRUE(d.edge(true, {100 * kMs}));
  EXPECT_FALSE(d.edge(false, {110 * kMs}));
  EXPECT_FALSE(d.passed({129 * kMs}));
  const auto release = d.passed({131 * kMs});
  ASSERT_TRUE(release);
  EXPECT_FALSE(release->pressed);
  EXPECT_EQ(release->when.ns, 110 * kMs);
  EXPECT_FALSE(d.passed({1000 * kMs}));
}

TEST(Debouncer, AWindowEndsWhenTheClockIsSetBack) {
  Debouncer d(30 * kMs);
  ASSERT_TRUE(d.edge(true, {5000 * kMs}));
  EXPECT_FALSE(d.passed({1000 * kMs}));
  const auto release = d.edge(false, {1000 * kMs});
  ASSERT_TRUE(release);
  EXPECT_FALSE(release->pressed);
  EXPECT_FALSE(d.edge(true, {1010 * kMs}));  // bounce again
  const auto press = d.passed({1031 * kMs});
  ASSERT_TRUE(press);
  EXPECT_TRUE(press->pressed);
}

/// Any contact: told states alternate, times are those of real edges and rise, and once the contact has been
/// still for a window the told state is the contact's.
TEST(Debouncer, HoldsForAnyContact) {
  Random random(20260607);
  for (int run = 0; run < 300; ++run) {
    Debouncer d(30 * kMs);
    std::int64_t now = 0, last = -1;
    bool contact = false, told = false;
    std::set<std::int64_t> edges;
    const auto check = [&](const std::optional<Debouncer::Change>& change) {
      if (!change) return;
      ASSERT_NE(change->pressed, told);
      ASSERT_TRUE(edges.count(change->when.ns));
      ASSERT_GT(change->when.ns, last);
      told = change->pressed;
      last = change->when.ns;
    };
    for (int i = 0; i < 100; ++i) {
      now += (1 + random.below(random.below(4) == 0 ? 200 : 8)) * kMs;
      while (const auto change = d.passed({now})) check(change);
      contact = random.below(2) == 0;
      edges.insert(now);
      check(d.edge(contact, {now}));
      ASSERT_EQ(d.pressed(), told);
    }
    now += 100 * kMs;
    while (const auto change = d.passed({now})) check(change);
    ASSERT_EQ(told, contact);
  }
}

}  // namespace
}  // namespace gnathion
