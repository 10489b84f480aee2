#include "daemon/services/support.h"
#include "gnathion/v1/jobs.grpc.pb.h"

namespace gnathion::daemon {
namespace {

api::Job::State state_of(JobState state) {
  return static_cast<api::Job::State>(state);
}
static_assert(static_cast<int>(JobState::kQueued) == api::Job::QUEUED);
static_assert(static_cast<int>(JobState::kRunning) == api::Job::RUNNING);
static_assert(static_cast<int>(JobState::kDone) == api::Job::DONE);
static_assert(static_cast<int>(JobState::kGateFailed) == api::Job::GATE_FAILED);
static_assert(static_cast<int>(JobState::kFailed) == api::Job::FAILED);
static_assert(static_cast<int>(JobState::kCancelled) == api::Job::CANCELLED);

api::JobOption::Type type_of(OptionType type) {
  switch (type) {
    case OptionType::kText:
      return api::JobOption::TEXT;
    case OptionType::kNumber:
      return api::JobOption::NUMBER;
    case OptionType::kFlag:
      return api::JobOption::FLAG;
    case OptionType::kInput:
      return api::JobOption::INPUT;
    case OptionType::kOutput:
      return api::JobOption::OUTPUT;
    case OptionType::kNumbers:
      return api::JobOption::NUMBERS;
  }
  return api::JobOption::TEXT;
}

void fill(api::Job& to, const JobView& from) {
  to.set_job_id(from.id);
  to.set_case_id(from.case_id);
  to.set_kind(from.kind);
  to.set_state(state_of(from.state));
  to.set_step(from.step);
  to.set_step_fraction(from.step_fraction);
  to.set_fraction(from.fraction);
  to.set_message(from.message);
  to.set_submitted_ns(from.submitted.ns);
  to.set_started_ns(from.started.ns);
  to.set_ended_ns(from.ended.ns);
  to.set_exit_code(from.exit_code);
  to.set_who(from.who);
}

class JobsService : public api::Jobs::Service {
 public:
  explicit JobsService(ServiceContext& context) : context_(context) {}

  grpc::Status Describe(grpc::ServerContext*, const api::DescribeJobsRequest*,
                        api::DescribeJobsResponse* response) override {
    for (const JobKind& kind : job_kinds()) {
      api::JobKind& to = *response->add_kind();
      to.set_name(kind.name);
      to.set_help(kind.help);
      for (const JobOption& option : kind.options) {
        api::JobOption& o = *to.add_option();
        o.set_name(option.name);
        o.set_type(type_of(option.type));
        o.set_required(option.required);
        o.set_repeated(option.repeated);
      }
    }
    return grpc::Status::OK;
  }

  grpc::Status Submit(grpc::ServerContext* call, const api::SubmitJobRequest* request,
                      api::Job* response) override {
    JobOrder order;
    order.case_id = request->case_id();
    order.kind = request->kind();
    order.force = request->force();
    order.who = context_.who(*call);
    if (request->value_size() > 256)
      return to_grpc({ApiCode::kInvalidArgument, "a job takes at most 256 options"});
    for (const api::JobValue& value : request->value())
      order.values.emplace_back(value.name(), value.value());
    const auto job = context_.jobs.submit(order);
    if (!job) return refused(context_, *call, "job.submit", order.case_id, job.error());
    fill(*response, *job);
    context_.audit.note(order.who, "job.submit", job->case_id, job->id + " " + job->kind);
    return grpc::Status::OK;
  }

  grpc::Status Progress(grpc::ServerContext* call, const api::JobRequest* request,
                        grpc::ServerWriter<api::Job>* writer) override {
    auto slot = context_.streams.take();
    if (!slot) return to_grpc(slot.error());
    const auto box = context_.jobs.watch(request->job_id());
    if (!box) return to_grpc(box.error());
    api::Job job;
    while (!call->IsCancelled() && !context_.going_down) {
      const auto mail = (*box)->take_within(std::chrono::milliseconds(100));
      if (!mail) continue;
      fill(job, *mail->value);
      job.set_missed(mail->missed);
      if (!writer->Write(job) || mail->value->finished()) break;
    }
    return grpc::Status::OK;
  }

  grpc::Status Cancel(grpc::ServerContext* call, const api::JobRequest* request,
                      api::Job* response) override {
    const auto job = context_.jobs.cancel(request->job_id());
    if (!job) return to_grpc(job.error());
    fill(*response, *job);
    context_.audit.note(context_.who(*call), "job.cancel", job->case_id, job->id);
    return grpc::Status::OK;
  }

  grpc::Status Result(grpc::ServerContext*, const api::JobRequest* request,
                      api::JobResult* response) override {
    const auto outcome = context_.jobs.outcome(request->job_id());
    if (!outcome) return to_grpc(outcome.error());
    fill(*response->mutable_job(), outcome->view);
    response->set_json(outcome->json);
    for (const std::string& output : outcome->outputs) response->add_output(output);
    return grpc::Status::OK;
  }

  grpc::Status List(grpc::ServerContext*, const api::ListJobsRequest* request,
                    api::ListJobsResponse* response) override {
    const std::size_t limit = request->limit() == 0 ? 100 : std::min(request->limit(), 1000u);
    for (const JobView& job : context_.jobs.list(request->case_id(), limit)) fill(*response->add_job(), job);
    return grpc::Status::OK;
  }

 private:
  ServiceContext& context_;
};

}  // namespace

std::unique_ptr<grpc::Service> make_jobs_service(ServiceContext& context) {
  return std::make_unique<JobsService>(context);
}

}  // namespace gnathion::daemon
