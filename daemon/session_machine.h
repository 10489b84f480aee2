// What each event does in each state of the session: one table, no clock, no thread, no side effect.
// docs/daemon.md shows it; a test holds the page against this table.
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace gnathion::daemon {

enum class State : std::uint8_t { kIdle, kArmed, kRecording, kStopping };
inline constexpr std::array kStates = {State::kIdle, State::kArmed, State::kRecording, State::kStopping};

enum class Event : std::uint8_t {
  kArm,           ///< a client arms the session
  kStart,         ///< a client starts a recording
  kMark,          ///< a client sets a mark
  kStop,          ///< a client ends the recording
  kDisarm,        ///< a client closes the devices
  kConfigure,     ///< a client gives a new devices.toml
  kHolderGone,    ///< the client that answers for the session has vanished
  kSourcesEnded,  ///< no device delivers any more, or the disk takes nothing more
  kFileClosed,    ///< the recording is whole and closed
  kReload,        ///< SIGHUP
  kTerminate      ///< SIGTERM
};
inline constexpr std::array kEvents = {Event::kArm,        Event::kStart,        Event::kMark,
                                       Event::kStop,       Event::kDisarm,       Event::kConfigure,
                                       Event::kHolderGone, Event::kSourcesEnded, Event::kFileClosed,
                                       Event::kReload,     Event::kTerminate};

enum class Action : std::uint8_t {
  kNothing,         ///< accepted, and nothing is to be done
  kOpenDevices,     ///< when this fails the state stays as it was
  kBeginRecording,  ///< when this fails the state stays as it was
  kWriteMark,
  kEndRecording,  ///< kFileClosed follows
  kCloseDevices,
  kTakeDevicesFile,
  kNoteHolderGone,      ///< an event in the recording and a line in the audit trail
  kReadConfiguration,   ///< all of gnathiond.toml that can change while running
  kReadWhenIdle,        ///< the same, but what concerns the session waits until it is idle
  kEndRecordingThenGo,  ///< kFileClosed follows, then the daemon ends
  kWaitThenGo,          ///< kFileClosed comes anyway; then the daemon ends
  kCloseDevicesThenGo,
  kGo,
  kRefuse
};

struct Transition {
  State next = State::kIdle;
  Action action = Action::kRefuse;
  std::string refusal;  ///< of kRefuse: what is wrong and what to do
  bool accepted() const { return action != Action::kRefuse; }
};

/// Total: defined for every pair.
Transition transition(State state, Event event);

const char* name_of(State state);    ///< "idle"
const char* name_of(Event event);    ///< "arm"
const char* name_of(Action action);  ///< "open the devices"

}  // namespace gnathion::daemon
