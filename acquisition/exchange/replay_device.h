// Any source as a device: a recording replayed, the virtual patient. Nothing above can tell it from an
// instrument.
#pragma once

#include <memory>

#include "acquisition/device.h"

namespace gnathion {

/// How a source that is not live is played.
struct PlayOptions {
  bool pace = true;  ///< each sample waits until its arrival, told from the first one's, has come on `clock`
};

/// The source's samples as they are, names and times unchanged. Ends when the source does.
std::unique_ptr<Device> make_source_device(std::unique_ptr<Source> source, DeviceDescription description,
                                           const PlayOptions& options, Clock& clock);

/// Kind "replay": keys `file`, `pace` (default true). docs/exchange.md.
Result<std::unique_ptr<Device>> open_replay_device(const DeviceConfig& config, Clock& clock);

}  // namespace gnathion
