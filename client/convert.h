// From the API's messages to the plain structs of the client library. For client/*.cc alone.
#pragma once

#include "client/daemon_client.h"
#include "gnathion/v1/capture.pb.h"
#include "gnathion/v1/cases.pb.h"
#include "gnathion/v1/devices.pb.h"
#include "gnathion/v1/jobs.pb.h"
#include "gnathion/v1/live.pb.h"

namespace gnathion::client {

DeviceInfo plain(const v1::Device& from);
Health plain(const v1::HealthResponse& from);
Session plain(const v1::SessionState& from);
PoseUpdate plain(const v1::PoseUpdate& from);
EventUpdate plain(const v1::EventUpdate& from);
Preview plain(const v1::Preview& from);
LedgerUpdate plain(const v1::LedgerUpdate& from);
Job plain(const v1::Job& from);
JobKind plain(const v1::JobKind& from);
Case plain(const v1::CaseInfo& from);

}  // namespace gnathion::client
