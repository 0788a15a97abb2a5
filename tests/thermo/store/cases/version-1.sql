BEGIN TRANSACTION;
CREATE TABLE events (
	id INTEGER NOT NULL, 
	test_id VARCHAR NOT NULL, 
	run INTEGER, 
	time_s DOUBLE, 
	kind VARCHAR NOT NULL, 
	text TEXT NOT NULL, 
	logged_utc VARCHAR NOT NULL, 
	PRIMARY KEY (id), 
	FOREIGN KEY(test_id) REFERENCES tests (id)
);
INSERT INTO "events" VALUES(1,'20261130T235552-3df1',NULL,0.0,'begun','2 runs of 28 slots','2026-11-30T23:55:52.435872+00:00');
INSERT INTO "events" VALUES(2,'20261130T235552-3df1',1,0.0,'approach','to 20 °C','2026-11-30T23:55:52.456254+00:00');
INSERT INTO "events" VALUES(3,'20261130T235552-3df1',1,-0.5,'schedule','{"start_clock_s": 140.5, "shift_s": 0.0, "segment": 0, "attempt": 1, "clock": "SteppedClock 8252.140455318150480"}','2026-11-30T23:55:54.919898+00:00');
INSERT INTO "events" VALUES(4,'20261130T235552-3df1',1,0.0,'segment','0: hold 20 °C for 2 min','2026-11-30T23:55:54.948044+00:00');
INSERT INTO "events" VALUES(5,'20261130T235552-3df1',1,120.0,'segment','1: ramp to 26 °C at 2 °C/min','2026-11-30T23:55:55.047912+00:00');
INSERT INTO "events" VALUES(6,'20261130T235552-3df1',1,165.0,'pause','schedule held before slot 12, 21.50 °C','2026-11-30T23:55:55.099977+00:00');
INSERT INTO "events" VALUES(7,'20261130T235552-3df1',1,215.0,'gap','50.0 s of pause before slot 12','2026-11-30T23:55:55.107987+00:00');
INSERT INTO "events" VALUES(8,'20261130T235552-3df1',1,215.0,'schedule','{"start_clock_s": 140.5, "shift_s": 0.0, "segment": 1, "attempt": 2, "clock": "SteppedClock 8252.140455318150480"}','2026-11-30T23:55:55.131983+00:00');
INSERT INTO "events" VALUES(9,'20261130T235552-3df1',1,215.0,'resoak','segment 1 from 20 °C again, attempt 2, after 3 min there','2026-11-30T23:55:55.139743+00:00');
INSERT INTO "events" VALUES(10,'20261130T235552-3df1',1,445.0,'schedule','{"start_clock_s": 140.5, "shift_s": 325.5, "segment": 1, "attempt": 2, "clock": "SteppedClock 8252.140455318150480"}','2026-11-30T23:55:55.156343+00:00');
INSERT INTO "events" VALUES(11,'20261130T235552-3df1',1,445.5,'segment','1: ramp to 26 °C at 2 °C/min','2026-11-30T23:55:55.177381+00:00');
INSERT INTO "events" VALUES(12,'20261130T235552-3df1',1,475.5,'safe','held; read back; head: stopped','2026-11-30T23:55:55.216037+00:00');
INSERT INTO "events" VALUES(13,'20261130T235552-3df1',1,475.5,'link','chamber: LinkCounters(exchanges=0, retries=0, timeouts=0, reconnects=0, bad_replies=0, last_fault='''', by_command={})','2026-11-30T23:55:55.227213+00:00');
INSERT INTO "events" VALUES(14,'20261130T235552-3df1',1,475.5,'link','digitiser: LinkCounters(exchanges=0, retries=0, timeouts=0, reconnects=0, bad_replies=0, last_fault='''', by_command={})','2026-11-30T23:55:55.231657+00:00');
INSERT INTO "events" VALUES(15,'20261130T235552-3df1',1,475.5,'link','head: LinkCounters(exchanges=0, retries=0, timeouts=0, reconnects=0, bad_replies=0, last_fault='''', by_command={})','2026-11-30T23:55:55.247733+00:00');
INSERT INTO "events" VALUES(16,'20261130T235552-3df1',NULL,0.0,'resumed','on modbus+tcp://192.0.2.10:502','2026-11-30T23:55:55.315712+00:00');
INSERT INTO "events" VALUES(17,'20261130T235552-3df1',1,5475.5,'gap','5000.0 s without readings before slot 11','2026-11-30T23:55:55.356070+00:00');
INSERT INTO "events" VALUES(18,'20261130T235552-3df1',1,5475.5,'schedule','{"start_clock_s": 140.5, "shift_s": 325.5, "segment": 1, "attempt": 3, "clock": "SteppedClock 8252.140455318150480"}','2026-11-30T23:55:55.377540+00:00');
INSERT INTO "events" VALUES(19,'20261130T235552-3df1',1,5475.5,'resoak','segment 1 from 20 °C again, attempt 3, after 3 min there','2026-11-30T23:55:55.391820+00:00');
INSERT INTO "events" VALUES(20,'20261130T235552-3df1',1,5515.5,'safe','held; read back; head: stopped','2026-11-30T23:55:55.396925+00:00');
INSERT INTO "events" VALUES(21,'20261130T235552-3df1',1,5515.5,'link','chamber: LinkCounters(exchanges=0, retries=0, timeouts=0, reconnects=0, bad_replies=0, last_fault='''', by_command={})','2026-11-30T23:55:55.415795+00:00');
INSERT INTO "events" VALUES(22,'20261130T235552-3df1',1,5515.5,'link','digitiser: LinkCounters(exchanges=0, retries=0, timeouts=0, reconnects=0, bad_replies=0, last_fault='''', by_command={})','2026-11-30T23:55:55.427514+00:00');
INSERT INTO "events" VALUES(23,'20261130T235552-3df1',1,5515.5,'link','head: LinkCounters(exchanges=0, retries=0, timeouts=0, reconnects=0, bad_replies=0, last_fault='''', by_command={})','2026-11-30T23:55:55.443776+00:00');
CREATE TABLE readings (
	test_id VARCHAR NOT NULL, 
	run INTEGER NOT NULL, 
	slot INTEGER NOT NULL, 
	attempt INTEGER NOT NULL, 
	serial VARCHAR NOT NULL, 
	segment INTEGER NOT NULL, 
	time_s DOUBLE NOT NULL, 
	temp_c DOUBLE, 
	position_deg DOUBLE, 
	output DOUBLE, 
	chamber_c DOUBLE, 
	lateness_s DOUBLE, 
	flag VARCHAR NOT NULL, 
	PRIMARY KEY (test_id, run, slot, attempt, serial), 
	FOREIGN KEY(test_id, run) REFERENCES runs (test_id, number)
)
 WITHOUT ROWID

;
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,0,1,'QA-001',0,0.0,2.39757215340978859776e+01,0.0,-6.06364340793473055417e-04,2.0480836129404320189e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,0,1,'QA-002',0,0.04,2.39777877165855102248e+01,0.0,1.69202339034210864389e-03,2.0480836129404320189e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,1,1,'QA-001',0,15.0,2.37744456579424081601e+01,90.0,1.30578298203950393663e+00,2.03744755541091073771e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,1,1,'QA-002',0,15.04,2.37774265114903187172e+01,90.0,1.26743122167931310251e+00,2.03744755541091073771e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,2,1,'QA-001',0,30.0,2.35650448036873285664e+01,180.0,-8.03611758811912583848e-04,2.02916418547812718023e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,2,1,'QA-002',0,30.04,2.35681758920661081906e+01,180.0,0.000736601771815877,2.02916418547812718023e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,3,1,'QA-001',0,45.0,23.3649304017988,270.0,-1.30709171501244814095e+00,2.02271309048800524972e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,3,1,'QA-002',0,45.04,2.33679959442731046683e+01,270.0,-1.26499561056135800818e+00,2.02271309048800524972e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,4,1,'QA-001',0,60.0,2.31652163194860918329e+01,0.0,-6.08527827724727717398e-04,2.0176889726580306216e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,4,1,'QA-002',0,60.04,2.31652041456115398432e+01,0.0,1.68237184287295632283e-03,2.0176889726580306216e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,5,1,'QA-001',0,75.0,2.29642128788666468599e+01,90.0,1.3056792949550801719e+00,2.01377618575780310545e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,5,1,'QA-002',0,75.04,2.29625585210587246365e+01,90.0,1.26731748464961246902e+00,2.01377618575780310545e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,6,1,'QA-001',0,90.0,2.2773872210273225392e+01,180.0,-8.19576292250266875451e-04,2.01072890425591452876e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,6,1,'QA-002',0,90.04,2.27727474886989966762e+01,180.0,7.34211502744540138974e-04,2.01072890425591452876e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,7,1,'QA-001',0,105.0,2.25872813894180808342e+01,270.0,-1.30703525181834634416e+00,2.00835567903600455954e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,7,1,'QA-002',0,105.04,2.25902828588601778392e+01,270.0,-1.26488316136159517633e+00,2.00835567903600455954e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,8,1,'QA-001',1,120.0,2.24100032839664891075e+01,0.0,-6.14894162526756103345e-04,2.00650740937633358389e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,8,1,'QA-002',1,120.04,2.24126900458755358154e+01,0.0,0.00170408523188818,2.00650740937633358389e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,8,2,'QA-001',1,445.5,2.06779470233726669903e+01,0.0,-6.28904331490511480859e-04,2.0023034424764741602e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,8,2,'QA-002',1,445.54,2.06816822426601447664e+01,0.0,1.71843762934248520286e-03,2.0023034424764741602e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,9,1,'QA-001',1,135.0,2.22434439108080255213e+01,90.0,1.30560567398845761566e+00,2.01263520728645488593e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,9,1,'QA-002',1,135.04,2.22435125985326180857e+01,90.0,1.2672174080494094106e+00,2.01263520728645488593e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,9,2,'QA-001',1,460.5,2.06328210927093209643e+01,90.0,1.30541981074632684745e+00,2.00843124038659546224e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,9,2,'QA-002',1,460.54,2.06340242742044210899e+01,90.0,1.26697915474395017554e+00,2.00843124038659546224e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,10,1,'QA-001',1,150.0,2.20850360800093312727e+01,180.0,-8.10707461053533054613e-04,2.02846750194379090706e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,10,1,'QA-002',1,150.04,2.20879867890022865131e+01,180.0,7.40202110875337474307e-04,2.02846750194379090706e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,10,2,'QA-001',1,475.5,2.05888892955189817257e+01,180.0,-8.36432760541241438791e-04,2.02426353504393148337e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,10,2,'QA-002',1,475.54,2.05908295094938580409e+01,180.0,7.60647274967140565524e-04,2.02426353504393148337e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,11,1,'QA-001',1,165.0,2.19398701885536979712e+01,270.0,-1.30697855047806399397e+00,2.05185766626717196463e+01,0.0,'');
INSERT INTO "readings" VALUES('20261130T235552-3df1',1,11,1,'QA-002',1,165.04,2.19465901997588730409e+01,270.0,-1.26477767736968216283e+00,2.05185766626717196463e+01,0.0,'');
CREATE TABLE runs (
	test_id VARCHAR NOT NULL, 
	number INTEGER NOT NULL, 
	start_utc VARCHAR NOT NULL, 
	start_clock_s DOUBLE, 
	status VARCHAR NOT NULL, 
	PRIMARY KEY (test_id, number), 
	FOREIGN KEY(test_id) REFERENCES tests (id)
);
INSERT INTO "runs" VALUES('20261130T235552-3df1',1,'2026-11-30T23:55:54.895785+00:00',140.5,'interrupted');
CREATE TABLE schema_version (
	version INTEGER NOT NULL, 
	created_utc VARCHAR NOT NULL, 
	PRIMARY KEY (version)
);
INSERT INTO "schema_version" VALUES(1,'2026-11-30T23:55:52.287523+00:00');
CREATE TABLE tests (
	id VARCHAR NOT NULL, 
	created_utc VARCHAR NOT NULL, 
	name VARCHAR NOT NULL, 
	sequence_toml TEXT NOT NULL, 
	station_json TEXT NOT NULL, 
	versions_json TEXT NOT NULL, 
	settings_json TEXT NOT NULL, 
	status VARCHAR NOT NULL, 
	outcome TEXT NOT NULL, 
	safe_result_json TEXT NOT NULL, 
	PRIMARY KEY (id)
);
INSERT INTO "tests" VALUES('20261130T235552-3df1','2026-11-30T23:55:52.397632+00:00','short','name = "short"
accelerometers = [{serial = "QA-001", nominal_scale = 1.3, mount_deg = 0.0}, {serial = "QA-002", nominal_scale = 1.3, mount_deg = 0.0}]

[temperature]
start_c = 20.0
start_tolerance_c = 0.5
start_soak_min = 0.0
start_timeout_min = 240.0
approach_c_per_min = 1.0
segments = [{kind = "hold", duration_min = 2.0}, {kind = "ramp", to_c = 26.0, rate_c_per_min = 2.0}, {kind = "hold", duration_min = 2.0}]
repeats = 2
rest_h = 0.1
rest = {}

[positions]
angles_deg = [0.0, 90.0, 180.0, 270.0]
order = "fixed"
seed = 1
readings_per_position = 1

[sampling]
period_s = 15.0
settle_s = 0.5
switch_s = 0.017

[limits]
max_deviation_c = 5.0
max_deviation_min = 10.0
stuck_c = 3.0
max_failures = 5
max_failure_s = 300.0
max_thermistor_losses = 3
on_thermistor_lost = "end"
max_bad_share = 0.1

[uniformity]
band_fraction = 0.1
min_share_inside = 0.9
window_min = 5.0
transient_min = 15.0

[after_gap]
gap_rule = "resoak"
resoak_min = 3.0
max_gap_s = 600.0
','{"name":"f4t","gravity_m_s2":9.80665,"chamber":{"url":"modbus+tcp://192.0.2.10:502","unit_id":1,"baud":9600,"timeout_s":1.0,"retries":2,"model":"watlow_f4t","limits_c":[-55.0,85.0],"rate_limits_c_per_min":[0.05,5.0],"safe_temp_c":25.0,"decimals":1,"word_order":"low","confirmed":null},"digitiser":{"url":"serial:///dev/ttyUSB1","unit_id":1,"baud":57600,"timeout_s":10.0,"retries":2,"model":"keysight_34970a","nplc":1.0},"head":{"url":"serial:///dev/ttyUSB2","unit_id":1,"baud":19200,"timeout_s":1.0,"retries":2,"model":"newport_esp301","axis":1,"limits_deg":[-360.0,360.0],"speed_deg_per_s":40.0},"inputs":[{"serial":"QA-001","output_channel":101,"thermistor_channel":111,"output_unit":"mA","load_ohm":1000.0,"full_scale_v":10.0,"thermistor":{"a":0.001129148,"b":0.000234125,"c":8.76741e-8}},{"serial":"QA-002","output_channel":102,"thermistor_channel":112,"output_unit":"mA","load_ohm":1000.0,"full_scale_v":10.0,"thermistor":{"a":0.001129148,"b":0.000234125,"c":8.76741e-8}},{"serial":"QA-003","output_channel":103,"thermistor_channel":113,"output_unit":"mA","load_ohm":1000.0,"full_scale_v":10.0,"thermistor":{"a":0.001129148,"b":0.000234125,"c":8.76741e-8}}],"on_foreign_change":"end","guardian":{"margin_s":30.0},"emulation":null}','{"SQLAlchemy": "2.1.9", "accelbench": "0.1.0", "numpy": "2.4.6", "pymodbus": "3.16.1", "pyserial": "3.5", "python": "3.11.7", "scipy": "1.17.1"}','{"chamber": {}, "digitiser": {}, "head": {}, "identity": {"chamber": "fake chamber", "digitiser": "fake digitiser", "head": "fake head"}}','interrupted','interrupted again','{"verified": true, "commanded": true, "steps": ["held", "read back", "head: stopped"]}');
CREATE TABLE voided (
	test_id VARCHAR NOT NULL, 
	run INTEGER NOT NULL, 
	segment INTEGER NOT NULL, 
	attempt INTEGER NOT NULL, 
	flag VARCHAR NOT NULL, 
	created_utc VARCHAR NOT NULL, 
	PRIMARY KEY (test_id, run, segment, attempt), 
	FOREIGN KEY(test_id, run) REFERENCES runs (test_id, number)
);
INSERT INTO "voided" VALUES('20261130T235552-3df1',1,1,1,'superseded','2026-11-30T23:55:55.128458+00:00');
INSERT INTO "voided" VALUES('20261130T235552-3df1',1,1,2,'superseded','2026-11-30T23:55:55.364517+00:00');
CREATE INDEX ix_events_test_id ON events (test_id);
CREATE TRIGGER events_no_update BEFORE UPDATE ON events BEGIN SELECT RAISE(ABORT, 'events are only added, never changed'); END;
CREATE TRIGGER events_no_delete BEFORE DELETE ON events BEGIN SELECT RAISE(ABORT, 'events are only added, never changed'); END;
CREATE TRIGGER readings_no_update BEFORE UPDATE ON readings BEGIN SELECT RAISE(ABORT, 'readings are only added, never changed'); END;
CREATE TRIGGER readings_no_delete BEFORE DELETE ON readings BEGIN SELECT RAISE(ABORT, 'readings are only added, never changed'); END;
CREATE TRIGGER voided_no_update BEFORE UPDATE ON voided BEGIN SELECT RAISE(ABORT, 'voided are only added, never changed'); END;
CREATE TRIGGER voided_no_delete BEFORE DELETE ON voided BEGIN SELECT RAISE(ABORT, 'voided are only added, never changed'); END;
COMMIT;
