// The whole page: the header, which never moves, and below it one robot or all.

import { useEffect } from "preact/hooks";
import { refreshCameras } from "./cameras";
import { Header } from "./Header";
import { History } from "./History";
import { NotificationSwitch } from "./NotificationSwitch";
import { OrderBanners } from "./OrderBanners";
import { Overview } from "./Overview";
import { fragmentOf, isLost, robots, selectedName } from "./page_state";
import { openQuestion } from "./question";
import { QuestionDialog } from "./QuestionDialog";
import { RobotPage } from "./RobotPage";
import { StopResponses } from "./StopResponses";

export function Page() {
  const name = selectedName.value;
  const robot = name === null ? undefined : robots.value.get(name);
  const progress = robot?.status.job && robot.status.layers
    ? ` ${Math.floor((100 * robot.status.laid) / robot.status.layers)} %` : "";
  const state = robot?.status.state ?? robot?.status.connection;
  const title = robot ? `${name} ${state}${progress} - growbot` : "growbot robots";
  useEffect(() => { document.title = title; }, [title]);
  useEffect(() => { if (!isLost.value) void refreshCameras(); }, [isLost.value]);
  return (
    <>
      <Header />
      <main inert={openQuestion.value !== null}>
        <StopResponses />
        {robot ? <RobotPage key={name} robot={robot} /> : <Overview />}
        <History robotName={name} key={name === null ? "#" : fragmentOf(name)} />
        <NotificationSwitch />
      </main>
      <QuestionDialog />
      <OrderBanners />
    </>
  );
}
