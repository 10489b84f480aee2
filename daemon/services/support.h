// What the services of the API share. gRPC's headers stay in daemon/services/ and server.cc.
#pragma once

#include <grpcpp/grpcpp.h>

#include <atomic>
#include <memory>
#include <string>

#include "daemon/api_error.h"
#include "daemon/audit_log.h"
#include "daemon/case_import.h"
#include "daemon/config.h"
#include "daemon/heartbeat.h"
#include "daemon/jobs/job_runner.h"
#include "daemon/peers.h"
#include "daemon/session_control.h"
#include "gnathion/v1/devices.pb.h"
#include "pipeline/catalogue.h"

namespace gnathion::daemon {

namespace api = ::gnathion::v1;

/// A bounded number of something that goes on at one time.
class Slots {
 public:
  Slots(const char* what, const char* key, int limit) : what_(what), key_(key), limit_(limit) {}
  class Slot {
   public:
    explicit Slot(Slots* slots) : slots_(slots) {}
    Slot(Slot&& other) noexcept : slots_(std::exchange(other.slots_, nullptr)) {}
    ~Slot() {
      if (slots_) --slots_->used_;
    }

   private:
    Slots* slots_;
  };
  ApiResult<Slot> take();
  int used() const { return used_; }
  void set_limit(int limit) { limit_ = limit; }

 private:
  const char* what_;
  const char* key_;
  std::atomic<int> limit_, used_{0};
};

/// All that the services work with. Outlives the gRPC server.
struct ServiceContext {
  SessionControl& session;
  JobRunner& jobs;
  CaseImporter& importer;
  const CaseRoot& root;
  LiveChannels& channels;
  Catalogue& catalogue;
  AuditLog& audit;
  Heartbeats& heartbeats;
  Clock& clock;
  const PeerSocket* peers = nullptr;  ///< set before the first connection
  std::atomic<double> holder_grace_s{2};
  std::filesystem::path audit_file{};
  HostTime started{};
  Slots streams{"live streams", "streams", 64};
  std::atomic<bool> going_down{false};

  std::string who(const grpc::ServerContext& call) const;
};

grpc::Status to_grpc(const ApiError& error);
/// A refusal that somebody may have to answer for: told in the audit trail.
grpc::Status refused(ServiceContext& context, const grpc::ServerContext& call, const char* what,
                     const std::string& case_id, const ApiError& error);

void fill(api::Device& to, const SessionDevice& from);

std::unique_ptr<grpc::Service> make_devices_service(ServiceContext& context);
std::unique_ptr<grpc::Service> make_capture_service(ServiceContext& context);
std::unique_ptr<grpc::Service> make_live_service(ServiceContext& context);
std::unique_ptr<grpc::Service> make_cases_service(ServiceContext& context);
std::unique_ptr<grpc::Service> make_catalogue_service(ServiceContext& context);
std::unique_ptr<grpc::Service> make_jobs_service(ServiceContext& context);

}  // namespace gnathion::daemon
