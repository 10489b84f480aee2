#include "daemon/session_machine.h"

#include "core/check.h"

namespace gnathion::daemon {
namespace {

constexpr const char* kArmFirst = "the session is idle: arm it first";
constexpr const char* kStartFirst = "nothing is being recorded: start a recording first";
constexpr const char* kIsRecording = "a recording is running: stop it first";
constexpr const char* kIsStopping = "the recording is being closed: try again in a moment";
constexpr const char* kIsArmed = "the session is armed already: disarm it first";
constexpr const char* kDisarmFirst = "the devices are open: disarm the session first";
constexpr const char* kNotNow = "this cannot happen in this state";

Transition go(State next, Action action) {
  return {next, action, {}};
}

Transition when_idle(Event event) {
  const auto stay = [](Action action) { return go(State::kIdle, action); };
  const auto refuse = [](const char* why) { return Transition{State::kIdle, Action::kRefuse, why}; };
  switch (event) {
    case Event::kArm:
      return go(State::kArmed, Action::kOpenDevices);
    case Event::kStart:
    case Event::kMark:
      return refuse(kArmFirst);
    case Event::kStop:
      return refuse(kStartFirst);
    case Event::kDisarm:
    case Event::kHolderGone:
      return stay(Action::kNothing);
    case Event::kConfigure:
      return stay(Action::kTakeDevicesFile);
    case Event::kSourcesEnded:
    case Event::kFileClosed:
      return refuse(kNotNow);
    case Event::kReload:
      return stay(Action::kReadConfiguration);
    case Event::kTerminate:
      return stay(Action::kGo);
  }
  return refuse(kNotNow);
}

Transition when_armed(Event event) {
  const auto stay = [](Action action) { return go(State::kArmed, action); };
  const auto refuse = [](const char* why) { return Transition{State::kArmed, Action::kRefuse, why}; };
  switch (event) {
    case Event::kArm:
      return refuse(kIsArmed);
    case Event::kStart:
      return go(State::kRecording, Action::kBeginRecording);
    case Event::kMark:
    case Event::kStop:
      return refuse(kStartFirst);
    case Event::kDisarm:
    case Event::kHolderGone:
      return go(State::kIdle, Action::kCloseDevices);
    case Event::kConfigure:
      return refuse(kDisarmFirst);
    case Event::kSourcesEnded:
      return stay(Action::kNothing);
    case Event::kFileClosed:
      return refuse(kNotNow);
    case Event::kReload:
      return stay(Action::kReadWhenIdle);
    case Event::kTerminate:
      return go(State::kIdle, Action::kCloseDevicesThenGo);
  }
  return refuse(kNotNow);
}

Transition when_recording(Event event) {
  const auto stay = [](Action action) { return go(State::kRecording, action); };
  const auto refuse = [](const char* why) { return Transition{State::kRecording, Action::kRefuse, why}; };
  switch (event) {
    case Event::kArm:
    case Event::kStart:
    case Event::kDisarm:
    case Event::kConfigure:
      return refuse(kIsRecording);
    case Event::kMark:
      return stay(Action::kWriteMark);
    case Event::kStop:
    case Event::kSourcesEnded:
      return go(State::kStopping, Action::kEndRecording);
    case Event::kHolderGone:
      return stay(Action::kNoteHolderGone);
    case Event::kFileClosed:
      return refuse(kNotNow);
    case Event::kReload:
      return stay(Action::kReadWhenIdle);
    case Event::kTerminate:
      return go(State::kStopping, Action::kEndRecordingThenGo);
  }
  return refuse(kNotNow);
}

Transition when_stopping(Event event) {
  const auto stay = [](Action action) { return go(State::kStopping, action); };
  const auto refuse = [](const char* why) { return Transition{State::kStopping, Action::kRefuse, why}; };
  switch (event) {
    case Event::kArm:
    case Event::kStart:
    case Event::kMark:
    case Event::kStop:
    case Event::kDisarm:
    case Event::kConfigure:
      return refuse(kIsStopping);
    case Event::kHolderGone:
    case Event::kSourcesEnded:
      return stay(Action::kNothing);
    case Event::kFileClosed:
      return go(State::kArmed, Action::kNothing);
    case Event::kReload:
      return stay(Action::kReadWhenIdle);
    case Event::kTerminate:
      return stay(Action::kWaitThenGo);
  }
  return refuse(kNotNow);
}

}  // namespace

Transition transition(State state, Event event) {
  switch (state) {
    case State::kIdle:
      return when_idle(event);
    case State::kArmed:
      return when_armed(event);
    case State::kRecording:
      return when_recording(event);
    case State::kStopping:
      return when_stopping(event);
  }
  GNATHION_CHECK(false);
  return {};
}

const char* name_of(State state) {
  constexpr std::array names = {"idle", "armed", "recording", "stopping"};
  return names[static_cast<std::size_t>(state)];
}

const char* name_of(Event event) {
  constexpr std::array names = {"arm",         "start",     "mark",        "stop",
                                "disarm",      "configure", "holder gone", "sources ended",
                                "file closed", "reload",    "terminate"};
  return names[static_cast<std::size_t>(event)];
}

const char* name_of(Action action) {
  constexpr std::array names = {"nothing",
                                "open the devices",
                                "begin the recording",
                                "write the mark",
                                "end the recording",
                                "close the devices",
                                "take the devices file",
                                "note it",
                                "read the configuration",
                                "read the configuration when idle",
                                "end the recording, then go",
                                "wait, then go",
                                "close the devices, then go",
                                "go",
                                "refuse"};
  return names[static_cast<std::size_t>(action)];
}

}  // namespace gnathion::daemon
