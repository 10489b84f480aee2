#include "acquisition/usb/transport.h"

#include <fmt/format.h>

namespace gnathion {

const char* name_of(TransferStatus status) {
  switch (status) {
    case kTransferOk:
      return "ok";
    case kTransferIo:
      return "i/o error";
    case kTransferAccess:
      return "no permission";
    case kTransferGone:
      return "device gone";
    case kTransferBusy:
      return "busy";
    case kTransferTimeout:
      return "timeout";
    case kTransferOverflow:
      return "babble";
    case kTransferStall:
      return "stall";
    case kTransferOther:
      break;
  }
  return "transfer failed";
}

std::string usb_id(std::uint16_t vendor, std::uint16_t product) {
  return fmt::format("{:04x}:{:04x}", vendor, product);
}

namespace {

std::string listed(const std::vector<InstrumentIdentity>& found) {
  std::vector<std::string> lines;
  for (const InstrumentIdentity& i : found)
    lines.push_back(fmt::format("{} at port {}{}", i.model.empty() ? usb_id(i.vendor, i.product) : i.model,
                                i.port, i.serial.empty() ? "" : fmt::format(" with serial {}", i.serial)));
  return fmt::format("{}", fmt::join(lines, ", "));
}

}  // namespace

Result<std::size_t> choose_instrument(const std::vector<InstrumentIdentity>& found,
                                      const InstrumentChoice& choice,
                                      const std::optional<InstrumentIdentity>& last, const std::string& what,
                                      const std::string& where) {
  const std::string failed = "cannot open " + what;
  if (found.empty()) return bad_input(failed, where, "none is connected");
  std::vector<std::size_t> fit;
  for (std::size_t i = 0; i < found.size(); ++i)
    if ((!choice.serial || found[i].serial == *choice.serial) &&
        (!choice.port || found[i].port == *choice.port))
      fit.push_back(i);
  if (fit.size() == 1) return fit.front();
  if (last)
    for (const std::size_t i : fit)
      if (found[i].serial == last->serial && found[i].port == last->port) return i;
  if (fit.empty())
    return bad_input(failed, where,
                     fmt::format("none{}{}; there is {}",
                                 choice.serial ? fmt::format(" with serial {}", *choice.serial) : "",
                                 choice.port ? fmt::format(" at port {}", *choice.port) : "", listed(found)));
  std::vector<InstrumentIdentity> candidates;
  for (const std::size_t i : fit) candidates.push_back(found[i]);
  if (choice.serial)
    return bad_input(
        failed, where,
        fmt::format("{} have one serial: {}; tell them apart by 'port'", fit.size(), listed(candidates)));
  return bad_input(
      failed, where,
      fmt::format("{} are connected: {}; say which by 'serial' or 'port'", fit.size(), listed(candidates)));
}

tl::unexpected<Error> no_permission(const std::string& what, const std::string& where,
                                    const std::string& node) {
  return bad_input("cannot open " + what, where,
                   fmt::format("no permission for {}; install packaging/udev/70-gnathion.rules to "
                               "/etc/udev/rules.d, run 'udevadm control --reload' and plug it in again",
                               node));
}

}  // namespace gnathion
