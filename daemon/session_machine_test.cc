#include "daemon/session_machine.h"

#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <regex>
#include <sstream>

namespace gnathion::daemon {
namespace {

TEST(SessionMachine, EveryPairIsDefinedAndRefusalsSayWhatToDo) {
  for (const State state : kStates)
    for (const Event event : kEvents) {
      const Transition t = transition(state, event);
      EXPECT_STRNE(name_of(t.action), "");
      if (t.accepted()) continue;
      EXPECT_EQ(t.next, state) << name_of(state) << " " << name_of(event);
      EXPECT_GT(t.refusal.size(), 20u) << name_of(state) << " " << name_of(event);
    }
}

TEST(SessionMachine, ARecordingGoesFromIdleToIdle) {
  State state = State::kIdle;
  const auto go = [&](Event event, Action action) {
    const Transition t = transition(state, event);
    EXPECT_EQ(t.action, action) << name_of(state) << " " << name_of(event);
    state = t.next;
  };
  go(Event::kArm, Action::kOpenDevices);
  go(Event::kStart, Action::kBeginRecording);
  go(Event::kMark, Action::kWriteMark);
  go(Event::kHolderGone, Action::kNoteHolderGone);
  go(Event::kStop, Action::kEndRecording);
  EXPECT_EQ(state, State::kStopping);
  go(Event::kFileClosed, Action::kNothing);
  go(Event::kDisarm, Action::kCloseDevices);
  EXPECT_EQ(state, State::kIdle);
}

/// Whatever happens, a recording is left only by closing its file, and devices only when nothing is recorded.
TEST(SessionMachine, NothingLosesARecording) {
  for (const Event event : kEvents) {
    const Transition t = transition(State::kRecording, event);
    if (t.accepted()) {
      EXPECT_TRUE(t.next == State::kRecording || t.next == State::kStopping) << name_of(event);
    }
    EXPECT_NE(t.action, Action::kCloseDevices) << name_of(event);
    EXPECT_NE(t.action, Action::kReadConfiguration) << name_of(event);
    EXPECT_NE(t.action, Action::kGo) << name_of(event);
    const Transition s = transition(State::kStopping, event);
    EXPECT_EQ(s.next, event == Event::kFileClosed ? State::kArmed : State::kStopping) << name_of(event);
  }
}

TEST(SessionMachine, TerminateEndsTheDaemonFromEveryState) {
  EXPECT_EQ(transition(State::kIdle, Event::kTerminate).action, Action::kGo);
  EXPECT_EQ(transition(State::kArmed, Event::kTerminate).action, Action::kCloseDevicesThenGo);
  EXPECT_EQ(transition(State::kRecording, Event::kTerminate).action, Action::kEndRecordingThenGo);
  EXPECT_EQ(transition(State::kStopping, Event::kTerminate).action, Action::kWaitThenGo);
}

/// docs/daemon.md, "What each event does": | event | idle | armed | recording | stopping |, each cell
/// "action" or "action → state" or "refused".
TEST(SessionMachine, ThePageShowsThisTable) {
  std::ifstream in("docs/daemon.md");
  ASSERT_TRUE(in) << "run from the repository's root";
  std::map<std::string, std::vector<std::string>> rows;
  for (std::string line; std::getline(in, line);) {
    if (line.rfind("| ", 0) != 0) continue;
    std::vector<std::string> cells;
    std::stringstream row(line.substr(1));
    for (std::string cell; std::getline(row, cell, '|');) {
      const auto first = cell.find_first_not_of(' ');
      cells.push_back(
          first == std::string::npos ? "" : cell.substr(first, cell.find_last_not_of(' ') - first + 1));
    }
    if (cells.size() == 5) rows[cells[0]] = {cells.begin() + 1, cells.end()};
  }
  for (const Event event : kEvents) {
    ASSERT_TRUE(rows.count(name_of(event))) << name_of(event) << " has no row";
    for (std::size_t i = 0; i < kStates.size(); ++i) {
      const Transition t = transition(kStates[i], event);
      std::string cell = t.accepted() ? name_of(t.action) : "refused";
      if (t.accepted() && t.next != kStates[i]) cell += std::string(" → ") + name_of(t.next);
      EXPECT_EQ(rows[name_of(event)][i], cell) << name_of(event) << " in " << name_of(kStates[i]);
    }
  }
}

}  // namespace
}  // namespace gnathion::daemon
