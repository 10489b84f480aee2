#include "viewer/widgets/frames_view.h"

#include <QMouseEvent>
#include <QPainter>
#include <cmath>

namespace gnathion {
namespace {

QString shown(std::string name) {
  for (char& c : name)
    if (c == '_') c = ' ';
  QString text = QString::fromStdString(name);
  return text.replace(" mi", " MI").replace(" tp", " TP");
}

/// The place along an edge, or a little beside it, where a label covers least of what is there already.
QRectF free_place(QRectF label, const QPointF& from, const QPointF& to, const std::vector<QRectF>& taken) {
  double least = 1e300;
  QRectF best = label;
  for (const double along : {0.5, 0.42, 0.58, 0.34, 0.66})
    for (const double beside_px : {0.0, 12.0, -12.0, 22.0, -22.0}) {
      label.moveCenter(from + along * (to - from) + QPointF(0, beside_px));
      double covered = 0.4 * std::abs(beside_px) + 20 * std::abs(along - 0.5);
      for (const QRectF& other : taken) {
        const QRectF both = label.intersected(other);
        covered += both.width() * both.height();
      }
      if (covered < least) least = covered, best = label;
    }
  return best;
}

}  // namespace

FramesView::FramesView(QWidget* parent) : QWidget(parent) {
  setObjectName("framesView");
  setMinimumHeight(180);
}

void FramesView::set_graph(std::optional<FramesGraph> graph) {
  graph_ = std::move(graph);
  at_teeth_mm_.clear();
  suspect_.clear();
  chosen_.reset();
  if (graph_) {
    suspect_.assign(graph_->edges().size(), false);
    for (const FrameSuspect& s : graph_->suspects(graph_->loops())) suspect_[s.edge] = true;
    for (const FrameEdge& e : graph_->edges()) {
      FramesGraph alone(graph_->teeth_mm());  // the edge's own error, not that of the best way round
      std::optional<double> mm;
      if (e.covariance && alone.add(e))
        if (const Result<FramePath> path = alone.path(e.to, e.from)) mm = path->at_teeth_mm;
      at_teeth_mm_.push_back(mm);
    }
  }
  update();
}

/// On an ellipse, in the order of a walk along edges, so that neighbours stand together.
std::map<std::string, QPointF> FramesView::places() const {
  std::map<std::string, QPointF> out;
  std::vector<std::string> order, names = graph_->frames();
  const auto visit = [&](const auto& again, const std::string& name) -> void {
    for (const std::string& n : order)
      if (n == name) return;
    order.push_back(name);
    for (const FrameEdge& e : graph_->edges()) {
      if (e.to == name) again(again, e.from);
      if (e.from == name) again(again, e.to);
    }
  };
  for (const std::string& n : names) visit(visit, n);
  const double n = static_cast<double>(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const double a = 6.283185307 * (static_cast<double>(i) + 0.5) / n - 1.5708;
    out[order[i]] = QPointF(width() * (0.5 + 0.40 * std::cos(a)), height() * (0.5 + 0.39 * std::sin(a)));
  }
  return out;
}

void FramesView::paintEvent(QPaintEvent*) {
  QPainter painter(this);
  painter.fillRect(rect(), Qt::white);
  painter.setRenderHint(QPainter::Antialiasing);
  if (!graph_ || graph_->edges().empty()) {
    painter.setPen(QColor(96, 103, 116));
    painter.drawText(rect().adjusted(12, 0, -12, 0), Qt::AlignCenter | Qt::TextWordWrap,
                     "No frames are registered yet: 'gnathion run' makes the graph.");
    return;
  }
  const auto at = places();
  painter.setFont(QFont(font().family(), 8));
  struct EdgeLabel {
    QPointF from, to;
    QString text;
  };
  std::vector<EdgeLabel> labels;
  for (std::size_t i = 0; i < graph_->edges().size(); ++i) {
    const FrameEdge& e = graph_->edges()[i];
    const QPointF a = at.at(e.from), b = at.at(e.to);
    const bool strong = chosen_ == i;
    painter.setPen(QPen(suspect_[i] ? QColor(170, 30, 20)
                        : strong    ? QColor(200, 120, 0)
                                    : QColor(100, 120, 145),
                        strong ? 3.5 : 2, suspect_[i] ? Qt::DashLine : Qt::SolidLine));
    painter.drawLine(a, b);
    const QString text =
        at_teeth_mm_[i] ? QString("%1 mm").arg(*at_teeth_mm_[i], 0, 'f', 3) : QString("error unknown");
    labels.push_back({a, b, text});
  }
  painter.setFont(QFont(font().family(), 9, QFont::DemiBold));
  std::vector<QRectF> taken;
  for (const auto& [name, p] : at) {
    QRectF box = painter.fontMetrics().boundingRect(shown(name)).adjusted(-8, -4, 8, 4);
    box.moveCenter(p);
    box.moveLeft(std::clamp(box.left(), 2.0, width() - box.width() - 2));
    taken.push_back(box);
    const bool home = name == "dental";
    painter.setPen(QPen(QColor(60, 84, 115), 1.2));
    painter.setBrush(home ? QColor(35, 82, 130) : QColor(233, 239, 246));
    painter.drawRoundedRect(box, 5, 5);
    painter.setPen(home ? Qt::white : QColor(28, 36, 48));
    painter.drawText(box, Qt::AlignCenter, shown(name));
  }
  painter.setFont(QFont(font().family(), 8));
  for (const EdgeLabel& label : labels) {
    const QRectF box = free_place(painter.fontMetrics().boundingRect(label.text).adjusted(-3, 0, 3, 0),
                                  label.from, label.to, taken);
    taken.push_back(box);
    painter.fillRect(box, QColor(255, 255, 255, 235));
    painter.setPen(QColor(60, 66, 78));
    painter.drawText(box, Qt::AlignCenter, label.text);
  }
}

void FramesView::mousePressEvent(QMouseEvent* event) {
  if (!graph_) return;
  const auto at = places();
  double nearest = 12;
  std::optional<std::size_t> hit;
  for (std::size_t i = 0; i < graph_->edges().size(); ++i) {
    const QPointF a = at.at(graph_->edges()[i].from), b = at.at(graph_->edges()[i].to), d = b - a;
    const double s = std::clamp(
        QPointF::dotProduct(event->localPos() - a, d) / std::max(1e-9, QPointF::dotProduct(d, d)), 0.0, 1.0);
    const QPointF off = event->localPos() - a - s * d;
    if (std::hypot(off.x(), off.y()) < nearest) nearest = std::hypot(off.x(), off.y()), hit = i;
  }
  if (!hit) return;
  chosen_ = hit;
  update();
  if (edge_clicked) edge_clicked(*hit);
}

}  // namespace gnathion
