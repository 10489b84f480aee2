#include <unistd.h>

#include <fstream>

#include "core/file.h"
#include "daemon/services/support.h"
#include "gnathion/v1/devices.grpc.pb.h"
#include "pipeline/capture_setup.h"
#include "pipeline/version.h"

namespace gnathion::daemon {
namespace {

/// Resident set, from /proc/self/statm.
double memory_mib() {
  std::ifstream statm("/proc/self/statm");
  long total = 0, resident = 0;
  statm >> total >> resident;
  return static_cast<double>(resident) * static_cast<double>(::sysconf(_SC_PAGESIZE)) / 1048576.0;
}

class DevicesService : public api::Devices::Service {
 public:
  explicit DevicesService(ServiceContext& context) : context_(context) {}

  grpc::Status List(grpc::ServerContext*, const api::ListDevicesRequest*,
                    api::ListDevicesResponse* response) override {
    const auto open = context_.session.ledger().devices;
    const auto text = read_file(context_.session.devices_file());
    if (text) response->set_configuration(without_passwords(*text));
    const auto setup = read_capture_setup(context_.session.devices_file());
    if (setup)
      for (const DeviceConfig& config : setup->configs) {
        api::Device& device = *response->add_device();
        device.set_stream(config.stream);
        device.set_kind(config.kind);
        device.set_message("closed: arm the session to open it");
        for (const SessionDevice& d : open)
          if (d.description.stream == config.stream) fill(device, d);
      }
    else if (text)
      return to_grpc(refuse(setup.error()).value());
    return grpc::Status::OK;
  }

  grpc::Status Configure(grpc::ServerContext* call, const api::ConfigureRequest* request,
                         api::ConfigureResponse* response) override {
    const auto streams = context_.session.configure(request->configuration());
    if (!streams) return refused(context_, *call, "devices.configure", {}, streams.error());
    std::string names;
    for (const std::string& stream : *streams) {
      response->add_stream(stream);
      names += (names.empty() ? "" : ", ") + stream;
    }
    context_.audit.note(context_.who(*call), "devices.configure", {}, names);
    return grpc::Status::OK;
  }

  grpc::Status Health(grpc::ServerContext*, const api::HealthRequest*,
                      api::HealthResponse* response) override {
    bool well = true;
    for (const SessionDevice& d : context_.session.ledger().devices) {
      fill(*response->add_device(), d);
      well = well && d.health.state != DeviceState::kFailed;
    }
    for (const LoopHealth& loop : context_.heartbeats.health()) {
      api::Loop& to = *response->add_loop();
      to.set_name(loop.name);
      to.set_age_s(loop.age_s);
      to.set_limit_s(loop.limit_s);
      well = well && loop.well();
    }
    if (const std::string fault = context_.audit.fault(); !fault.empty()) response->add_fault(fault);
    response->set_well(well && response->fault_size() == 0);
    response->set_version(kVersion);
    response->set_started_ns(context_.started.ns);
    response->set_memory_mib(memory_mib());
    response->set_connections(static_cast<unsigned>(context_.peers ? context_.peers->connections() : 0));
    response->set_streams(static_cast<unsigned>(context_.streams.used()));
    return grpc::Status::OK;
  }

 private:
  ServiceContext& context_;
};

}  // namespace

std::unique_ptr<grpc::Service> make_devices_service(ServiceContext& context) {
  return std::make_unique<DevicesService>(context);
}

}  // namespace gnathion::daemon
