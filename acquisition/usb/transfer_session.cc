#include "acquisition/usb/transfer_session.h"

namespace gnathion {

void TransferSession::take(const TransferSample& transfer, std::deque<Sample>& out) {
  passed(transfer.header.arrival, out);
  out.emplace_back(transfer);
  const auto status = static_cast<TransferStatus>(transfer.status);
  if (transfer.endpoint == kDescriptorEndpoint && status == kTransferOk) {
    if (present_) {
      lost(transfer, out);
      tell_state(transfer.header.arrival, false, "did not work; opened anew", out);
      present_ = false;
    }
    return opened(transfer, out);
  }
  if (status == kTransferGone) {
    if (!present_) return;
    present_ = false;
    lost(transfer, out);
    const bool given_up = transfer.endpoint == kDescriptorEndpoint;
    return tell_state(transfer.header.arrival, false, given_up ? "does not work; closed" : name_of(status),
                      out);
  }
  if (status != kTransferOk) out.emplace_back(rejected(raw_stream(), transfer.header, name_of(status)));
  const bool outwards = transfer.endpoint != 0 && !(transfer.endpoint & kDirectionIn);
  if (outwards) {
    if (status == kTransferOk) sent(transfer, out);
  } else if (!transfer.data.empty()) {
    received(transfer, out);
  }
}

Status TransferSession::start(TransferIo&) {
  return {};
}
void TransferSession::stop(TransferIo&) {}
void TransferSession::sent(const TransferSample&, std::deque<Sample>&) {}
void TransferSession::passed(HostTime, std::deque<Sample>&) {}

void TransferSession::tell_working(HostTime when, std::deque<Sample>& out) {
  if (present_) return;
  if (was_present_) tell_state(when, true, "connected again", out);
  present_ = was_present_ = true;
}

void TransferSession::tell_state(HostTime when, bool back, const std::string& text, std::deque<Sample>& out) {
  EventSample event;
  event.header.stream = stream_ + "/state";
  event.header.sequence = states_++;
  event.header.capture = event.header.arrival = when;
  event.kind = "device";
  event.pressed = back;
  event.text = text;
  out.emplace_back(std::move(event));
}

LedgerSample TransferSession::rejected(std::string stream, const SampleHeader& at, std::string reason) {
  LedgerSample line;
  line.header = at;
  line.header.stream = std::move(stream);
  line.fate = LedgerSample::Fate::kRejected;
  line.reason = std::move(reason);
  return line;
}

}  // namespace gnathion
