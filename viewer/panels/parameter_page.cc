#include "viewer/panels/parameter_page.h"

#include <QComboBox>
#include <QDoubleSpinBox>
#include <QHBoxLayout>

#include <algorithm>

#include <nlohmann/json.hpp>

#include "pipeline/design_job.h"
#include "viewer/widgets/parts.h"

namespace gnathion {
namespace {

constexpr int kMergeParameter = 200;
/// Everyday ones first; the rest follow in the table's order.
constexpr const char* kFirst[] = {"wall_mm",  "occlusal_thickness_mm", "gap_mm",
                                  "depth_mm", "engagement_mm",         "occlusion_clearance_mm"};

QString shown_name(const std::string& name) {
  QString text = QString::fromStdString(name);
  text.replace(QRegExp("_(mm|deg)$"), "").replace('_', ' ');
  text[0] = text[0].toUpper();
  return text;
}

std::vector<ParameterHelp> in_order() {
  std::vector<ParameterHelp> all = parameter_help();
  std::stable_sort(all.begin(), all.end(), [](const ParameterHelp& a, const ParameterHelp& b) {
    const auto rank = [](const std::string& n) {
      return std::find(std::begin(kFirst), std::end(kFirst), n) - std::begin(kFirst);
    };
    return rank(a.name) < rank(b.name);
  });
  return all;
}

}  // namespace

ParameterPage::ParameterPage(Document& document) : document_(document) {
  auto* page = new QWidget;
  auto* form = new QVBoxLayout(page);
  form->setContentsMargins(6, 6, 6, 6);
  form->setSpacing(2);
  arch_ = new QComboBox;
  arch_->setObjectName("archBox");
  arch_->addItems({"Worn on the maxilla", "Worn on the mandible"});
  connect(arch_, qOverload<int>(&QComboBox::currentIndexChanged), this, [this](int i) {
    if (!showing_)
      document_.change("Arch", [&](SessionState& s) { s.arch = i ? Arch::kMandible : Arch::kMaxilla; });
  });
  form->addWidget(arch_);
  int merge = kMergeParameter;
  for (const ParameterHelp& help : in_order()) form->addWidget(make_row(help, merge++));
  form->addWidget(button("Defaults", "parameterDefaults", "All parameters as published", [this] {
    document_.change("Default parameters", [](SessionState& s) { s.parameters = {}; });
  }));
  setWidget(page);
  setWidgetResizable(true);
  setFrameShape(QFrame::NoFrame);
  setHorizontalScrollBarPolicy(Qt::ScrollBarAlwaysOff);
}

QWidget* ParameterPage::make_row(const ParameterHelp& help, int merge) {
  auto* both = new QWidget;
  auto* column = new QVBoxLayout(both);
  column->setContentsMargins(0, 0, 0, 0);
  column->setSpacing(2);
  auto* row = new QHBoxLayout;
  auto* name = new QLabel(shown_name(help.name));
  auto* box = boxes_[help.name] = new QDoubleSpinBox;
  box->setObjectName("parameter_" + QString::fromStdString(help.name));
  box->setRange(help.low, help.high);
  const bool angle = help.unit == "deg";
  box->setDecimals(angle ? 1 : 2);
  box->setSingleStep(angle ? 1 : 0.05);
  box->setSuffix(angle ? " °" : help.unit == "mm" ? " mm" : "");
  box->setKeyboardTracking(false);
  box->setFixedWidth(92);
  const QString tip = QString("%1. Default %2, range %3 to %4 %5.")
                          .arg(QString::fromStdString(help.source))
                          .arg(help.default_value)
                          .arg(help.low)
                          .arg(help.high)
                          .arg(QString::fromStdString(help.unit));
  box->setToolTip(tip);
  name->setToolTip(tip);
  connect(box, qOverload<double>(&QDoubleSpinBox::valueChanged), this,
          [this, n = help.name, merge](double v) { take(n, v, merge); });
  connect(box, &QDoubleSpinBox::editingFinished, this, [this] { document_.end_merge(); });
  row->addWidget(name, 1);
  row->addWidget(box);
  column->addLayout(row);
  column->addWidget(wrapped(QString::fromStdString(help.source), true));
  return both;
}

void ParameterPage::take(const std::string& name, double value, int merge) {
  if (showing_) return;
  SplintParameters wanted = document_.state().parameters;
  const Status ok = set_parameter(wanted, "design." + name + "=" + std::to_string(value));
  const Status fits = ok ? check_parameters(wanted) : ok;
  if (!fits) {
    document_.report(QString::fromStdString(fits.error().line()));
    return show_values();
  }
  document_.change(
      shown_name(name), [&](SessionState& s) { s.parameters = wanted; }, merge);
}

void ParameterPage::show_values() {
  if (!document_.is_open()) return;
  showing_ = true;
  const nlohmann::json values = parameters_json(document_.state().parameters);
  for (const auto& [name, box] : boxes_)
    if (values.contains(name)) box->setValue(values[name].get<double>());
  arch_->setCurrentIndex(document_.state().arch == Arch::kMandible ? 1 : 0);
  showing_ = false;
}

}  // namespace gnathion
